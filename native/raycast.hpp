// A triangle soup in a bounding-volume hierarchy built once: rays (raycast.cpp), and what lies near or crosses
// (proximity.cpp).
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
  bool back = false;                 // it was hit from behind: the ray leaves through it
};

struct Nearest {
  double distance = std::numeric_limits<double>::infinity();
  std::int32_t triangle = -1;
};

class TriangleBvh {
 public:
  // Faces index into vertices; the caller has checked the range and that there is at least one face.
  TriangleBvh(const float* vertices, const std::int32_t* faces, std::size_t face_count);

  // The nearest hit with 0 < t. Of two triangles hit at the same t, the one with the smaller index.
  RayHit closest(const double origin[3], const double direction[3]) const;

  // Whether anything is hit with 0 < t < max_t.
  bool occluded(const double origin[3], const double direction[3], double max_t) const;

  // Triangles that the ray leaves through minus those it enters through: the winding number of a closed surface about
  // the origin, 1 inside an ordinary solid.
  std::int32_t winding(const double origin[3], const double direction[3]) const;

  // The nearest triangle within `limit`, of two equally near the one with the smaller index; -1 where none is.
  Nearest nearest(const double point[3], double limit) const;

  // Number of other triangles that triangle `order_[place]` cuts: they share a segment of positive length and are not
  // coplanar. Triangles that merely touch, in a common edge or corner or else, do not cut each other.
  std::int32_t crossings(std::size_t place) const;

  std::size_t size() const { return order_.size(); }
  std::int32_t triangle_at(std::size_t place) const { return order_[place]; }

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
