// A closed mesh while it is simplified: see simplify.hpp for what is promised.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <queue>
#include <vector>

#include "crossing.hpp"
#include "face_grid.hpp"
#include "quadric.hpp"
#include "simplify.hpp"

namespace goc::simplification {

constexpr double kTurn = 0.4;      // least cosine between the normals of a face before and after

// Results are handed on as floats: what is tested has to be what leaves.
inline Vec as_floats(Vec p) { return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)}; }

inline FaceBox box_of(const Triangle& face) {
  FaceBox box;
  for (const Vec corner : face) box.add(corner);
  return box;
}

constexpr int kRepairs = 6;

class Simplifier {
 public:
  Simplifier(const Surface& mesh, const SimplifyLimits& limits) : limits_(limits), square_(limits.tolerance * limits.tolerance) {
    read(mesh);
    std::vector<FaceBox> boxes;
    for (const Corners& face : faces_) boxes.push_back(box_of({place(face[0]), place(face[1]), place(face[2])}));
    grid_.emplace(boxes);
    for (const Corners& face : faces_) add_quadrics(face);
  }

  void run() {
    collapse_all();
    for (int round = 0; round < kRepairs; ++round) {
      const bool flipped = flip_all(), merged = merge_slivers(), moved = move_all();
      if (!flipped && !merged && !moved) break;
    }
  }

  Surface result() const;

 private:
  void read(const Surface& mesh);
  void add_quadrics(const Corners& face);
  bool alive(std::int32_t face) const { return faces_[face][0] >= 0; }
  Vec place(std::int32_t vertex) const { return places_[vertex]; }
  Vec normal(const Corners& f) const { return cross(place(f[1]) - place(f[0]), place(f[2]) - place(f[0])); }
  double quality_of(const Corners& f) const { return quality(place(f[0]), place(f[1]), place(f[2])); }

  void collapse_all();
  void push(std::int32_t from, std::int32_t to);
  void push_round(std::int32_t vertex);
  double cost_of(std::int32_t from, std::int32_t to, Vec& best) const;
  bool linked_once(std::int32_t from, std::int32_t to);
  bool collapse(std::int32_t from, std::int32_t to, Vec best);
  bool collapse_to(std::int32_t from, std::int32_t to, Vec goal);
  bool merge_slivers();
  bool flip_all();
  bool flip(std::int32_t first, int edge);
  bool move_all();

  // The change at hand: faces that go, each with its successor among those that come (-1: none), and the points told over.
  void begin() { gone_.clear(), come_.clear(), successor_.clear(); }
  bool shapes_hold(double least) const;
  bool points_hold();
  bool cuts_something();
  void hand_over(const std::vector<std::int32_t>& heirs);

  SimplifyLimits limits_;
  double square_;
  std::vector<Vertex> vertices_;
  std::vector<Vec> places_;                // of the vertices, apart from the rest: they are read most
  std::vector<Corners> faces_;
  std::size_t count_ = 0;
  std::vector<Vec> points_;                // the original's vertices
  std::vector<std::int32_t> first_, next_;  // of each face's points; next of each point
  std::priority_queue<Candidate> queue_;
  std::vector<std::int32_t> gone_, successor_;
  std::vector<Triangle> come_;
  std::vector<FaceBox> boxes_;             // of `come_`, as are the normals
  std::vector<Vec> normals_;
  std::optional<FaceGrid> grid_;
  std::vector<std::int32_t> told_, heir_;  // points of the change, and which of `come_` each goes to
  std::vector<std::uint32_t> mark_;
  std::uint32_t round_ = 0;
};

}  // namespace goc::simplification
