// Rays against a triangle soup: a bounding-volume hierarchy built once, then closest hits and occlusion tests.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace goc {

struct RayHit {
  double t = std::numeric_limits<double>::infinity();  // in lengths of the direction; infinity: nothing hit
  std::int32_t triangle = -1;
  double u = 0.0, v = 0.0, w = 0.0;  // barycentric weights of the triangle's three corners
};

class TriangleBvh {
 public:
  // Faces index into vertices; the caller has checked the range and that there is at least one face.
  TriangleBvh(const float* vertices, const std::int32_t* faces, std::size_t face_count);

  // The nearest hit with 0 < t. Of two triangles hit at the same t, the one with the smaller index.
  RayHit closest(const double origin[3], const double direction[3]) const;

  // Whether anything is hit with 0 < t < max_t.
  bool occluded(const double origin[3], const double direction[3], double max_t) const;

 private:
  // Four children side by side, so that one pass of vector arithmetic tests all their boxes.
  struct Node {
    float low[3][4], high[3][4];
    std::uint32_t first[4];  // leaf: its first place in order_; inner: its node
    std::uint32_t count[4];  // triangles of a leaf; 0 with first != 0: inner; 0 with first == 0: no child
  };
  struct Builder;

  std::vector<Node> nodes_;
  std::vector<std::int32_t> order_;            // triangle index at each place
  std::vector<std::array<float, 9>> corners_;  // a, b, c at each place, so that a leaf reads one run of memory
  float reach_ = 0.0f;                         // largest absolute coordinate

  template <class Visit>
  void traverse(const double origin[3], const double direction[3], const double& limit, Visit&& visit) const;
};

}  // namespace goc
