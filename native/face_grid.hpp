// Which faces of a changing mesh are near a box: their boxes in the cells of a grid, made anew as faces get fewer.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "triangle.hpp"

namespace goc {

struct FaceBox {
  std::array<float, 3> low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};

  void add(Vec p) {  // corners are floats
    const std::array<float, 3> at{static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
    add({at, at});
  }
  void add(const FaceBox& o) {
    for (int axis = 0; axis < 3; ++axis) low[axis] = std::min(low[axis], o.low[axis]), high[axis] = std::max(high[axis], o.high[axis]);
  }
  bool empty() const { return low[0] > high[0]; }
  bool meets(const FaceBox& o) const {
    bool met = true;
    for (int axis = 0; axis < 3; ++axis) met &= low[axis] <= o.high[axis] && o.low[axis] <= high[axis];
    return met;
  }
};

class FaceGrid {
 public:
  explicit FaceGrid(const std::vector<FaceBox>& boxes) : live_(boxes.size()) {
    for (const FaceBox& box : boxes) faces_.push_back({box, 0});
    build();
  }

  // Calls visit(face, its box) once for every face whose box meets the one given.
  template <class Visit>
  void visit(const FaceBox& box, Visit&& visit) {
    ++round_;
    const auto look = [&](std::int32_t face) {
      Face& f = faces_[face];
      if (f.round == round_ || !f.box.meets(box)) return;
      f.round = round_;
      visit(face, f.box);
    };
    each_cell(range(box), [&](std::size_t cell) {
      for (std::int32_t at = first_[cell]; at < first_[cell + 1]; ++at) look(members_[at]);
      for (std::int32_t at = late_[cell]; at >= 0; at = newcomers_[at].next) look(newcomers_[at].face);
    });
  }

  // A face has moved. Cells that it left keep naming it, which does no harm: its box tells.
  void put(std::int32_t face, const FaceBox& box) {
    const Range before = range(faces_[face].box);
    faces_[face].box = box;
    each_cell(range(box), [&](std::size_t cell) {
      if (within(before, cell)) return;
      newcomers_.push_back({face, late_[cell]});
      late_[cell] = static_cast<std::int32_t>(newcomers_.size()) - 1;
    });
  }

  void take(std::int32_t face) {
    faces_[face].box = FaceBox{};
    if (--live_ < built_ / 2) build();
  }

 private:
  static constexpr double kEdge = 2.0;  // of a cell, mean extents of faces
  struct Face {
    FaceBox box;
    std::uint32_t round;
  };
  struct Newcomer {
    std::int32_t face, next;
  };
  struct Range {
    std::array<int, 3> low, high;
  };

  void build() {
    FaceBox all;
    double extents = 0.0;
    for (const Face& face : faces_) {
      if (face.box.empty()) continue;
      all.add(face.box);
      for (int axis = 0; axis < 3; ++axis) extents += (face.box.high[axis] - face.box.low[axis]) / 3.0;
    }
    built_ = live_, origin_ = all.low;
    double cell = std::max(kEdge * extents / static_cast<double>(std::max<std::size_t>(live_, 1)), 1e-30), cells = INFINITY;
    for (; cells > 8.0 * static_cast<double>(live_) + 64.0; cell *= 1.25) {
      cells = 1.0, per_unit_ = 1.0 / cell;
      for (int axis = 0; axis < 3 && live_ > 0; ++axis)
        cells *= count_[axis] = static_cast<int>(std::min((all.high[axis] - all.low[axis]) / cell, 1e6)) + 1;
    }
    const std::size_t total = static_cast<std::size_t>(count_[0]) * count_[1] * count_[2];
    first_.assign(total + 1, 0), late_.assign(total, -1), newcomers_.clear();
    each_member([&](std::size_t cell, std::int32_t) { ++first_[cell]; });
    std::int32_t sum = 0;
    for (std::int32_t& entry : first_) sum += entry, entry = sum;
    members_.resize(sum);
    each_member([&](std::size_t cell, std::int32_t face) { members_[--first_[cell]] = face; });
  }

  template <class Act>
  void each_member(Act&& act) const {
    for (std::size_t face = 0; face < faces_.size(); ++face)
      if (!faces_[face].box.empty()) each_cell(range(faces_[face].box), [&](std::size_t cell) { act(cell, static_cast<std::int32_t>(face)); });
  }

  // What lies beyond the grid counts at its border.
  Range range(const FaceBox& box) const {
    Range found;
    for (int axis = 0; axis < 3; ++axis) {
      const double top = count_[axis] - 1.0;
      found.low[axis] = static_cast<int>(std::clamp((box.low[axis] - origin_[axis]) * per_unit_, 0.0, top));
      found.high[axis] = static_cast<int>(std::clamp((box.high[axis] - origin_[axis]) * per_unit_, 0.0, top));
    }
    return found;
  }

  template <class Act>
  void each_cell(const Range& r, Act&& act) const {
    for (int x = r.low[0]; x <= r.high[0]; ++x)
      for (int y = r.low[1]; y <= r.high[1]; ++y)
        for (int z = r.low[2]; z <= r.high[2]; ++z) act((static_cast<std::size_t>(x) * count_[1] + y) * count_[2] + z);
  }

  bool within(const Range& r, std::size_t cell) const {
    const int z = static_cast<int>(cell % count_[2]), y = static_cast<int>(cell / count_[2] % count_[1]),
              x = static_cast<int>(cell / count_[2] / count_[1]);
    return x >= r.low[0] && x <= r.high[0] && y >= r.low[1] && y <= r.high[1] && z >= r.low[2] && z <= r.high[2];
  }

  std::vector<Face> faces_;
  std::uint32_t round_ = 0;
  std::size_t live_, built_ = 0;
  std::array<float, 3> origin_{};
  std::array<int, 3> count_{1, 1, 1};
  double per_unit_ = 0.0;
  std::vector<std::int32_t> first_, members_;  // a cell's members are those from its first to the next cell's
  std::vector<std::int32_t> late_;             // its newcomers since the grid was made
  std::vector<Newcomer> newcomers_;
};

}  // namespace goc
