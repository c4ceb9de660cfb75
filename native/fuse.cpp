#include "fuse.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct Vec {
  float x, y, z;
  Vec operator+(Vec o) const { return {x + o.x, y + o.y, z + o.z}; }
  Vec operator*(float s) const { return {x * s, y * s, z * s}; }
};

// From voxels to camera space.
class Projector {
 public:
  Projector(const Lattice& lattice, const DepthView& view) {
    const double* m = view.camera.cam_from_world;
    for (int row = 0; row < 3; ++row) {
      const double* r = m + 4 * row;
      base_[row] = r[0] * lattice.origin[0] + r[1] * lattice.origin[1] + r[2] * lattice.origin[2] + r[3];
      for (int axis = 0; axis < 3; ++axis) step_[axis][row] = r[axis] * lattice.voxel;
    }
  }

  // Position of a block's first voxel; double, because it is the start of the block's increments.
  Vec at(const std::int32_t* block) const {
    double p[3];
    for (int row = 0; row < 3; ++row)
      p[row] = base_[row] + kBlockEdge * (block[0] * step_[0][row] + block[1] * step_[1][row] + block[2] * step_[2][row]);
    return {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
  }

  Vec step(int axis) const {
    return {static_cast<float>(step_[axis][0]), static_cast<float>(step_[axis][1]),
            static_cast<float>(step_[axis][2])};
  }

 private:
  double base_[3], step_[3][3];
};

// What some pixels measured.
struct Measured {
  float nearest = kInfinity, furthest = -kInfinity, least_slope = kInfinity;

  void add(const Measured& other) {
    nearest = std::min(nearest, other.nearest), furthest = std::max(furthest, other.furthest);
    least_slope = std::min(least_slope, other.least_slope);
  }
};

// A view's bounds of what was measured, tile by tile: enough to tell which blocks lie behind all of it, and which before.
class Tiles {
 public:
  explicit Tiles(const DepthView& view)
      : columns_((view.camera.width + kSide - 1) / kSide),
        tiles_(static_cast<std::size_t>(columns_) * ((view.camera.height + kSide - 1) / kSide)) {
    const int width = view.camera.width, height = view.camera.height;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const std::size_t pixel = static_cast<std::size_t>(y) * width + x;
        const float depth = view.depth[pixel], slope = view.slope[pixel];
        if (std::isnan(slope)) continue;
        const bool none = std::isnan(depth);  // then the kernel has something to say of all places along its ray
        tiles_[static_cast<std::size_t>(y / kSide) * columns_ + x / kSide].add(
            {none ? -kInfinity : depth, none ? kInfinity : depth, slope});
      }
  }

  // Of the pixels low … high, inclusive.
  Measured within(const int* low, const int* high) const {
    Measured all;
    for (int y = low[1] / kSide; y <= high[1] / kSide; ++y)
      for (int x = low[0] / kSide; x <= high[0] / kSide; ++x) all.add(tiles_[static_cast<std::size_t>(y) * columns_ + x]);
    return all;
  }

 private:
  static constexpr int kSide = 4;

  int columns_;
  std::vector<Measured> tiles_;
};

// How a block lies to the measured surface.
enum class Place { kOutside, kBehind, kNear, kBefore };

class Fuser {
 public:
  Fuser(const Lattice& lattice, const DepthView& view, int wanted)
      : projector_(lattice, view), tiles_(view), view_(fused(lattice, view, wanted)) {
    for (int corner = 0; corner < 8; ++corner)
      corners_[corner] = (projector_.step(0) * static_cast<float>(corner & 1) + projector_.step(1) * static_cast<float>(corner >> 1 & 1) +
                          projector_.step(2) * static_cast<float>(corner >> 2)) * (kBlockEdge - 1);
  }

  void block(const std::int32_t* coords, float* sums, std::size_t stride) const {
    const Vec first = projector_.at(coords);
    const Place place = place_of(first);
    if (place == Place::kOutside || place == Place::kBehind) return;
    const float start[3] = {first.x, first.y, first.z};
    kernels().fuse_block(view_, start, place == Place::kBefore, sums, stride);
  }

 private:
  FusedView fused(const Lattice& lattice, const DepthView& view, int wanted) const {
    const auto voxel = static_cast<float>(lattice.voxel), truncation = static_cast<float>(lattice.truncation);
    FusedView out{view.camera.lens(), {}, voxel, truncation, 1.0f / (truncation - voxel),
                  std::max(truncation, 0.5f * voxel), view.depth, view.slope, view.ids, view.colours, wanted};
    for (int axis = 0; axis < 3; ++axis) {
      const Vec step = projector_.step(axis);
      out.step[axis][0] = step.x, out.step[axis][1] = step.y, out.step[axis][2] = step.z;
    }
    return out;
  }

  Place place_of(Vec first) const {
    const Lens& lens = view_.lens;
    float z_low = kInfinity, z_high = -kInfinity, low[2] = {kInfinity, kInfinity}, high[2] = {-kInfinity, -kInfinity};
    for (const Vec& corner : corners_) {
      const Vec p = first + corner;
      z_low = std::min(z_low, p.z), z_high = std::max(z_high, p.z);
      const float scale = 1.0f / p.z, u = lens.fx * p.x * scale + lens.cx, v = lens.fy * p.y * scale + lens.cy;
      low[0] = std::min(low[0], u), high[0] = std::max(high[0], u), low[1] = std::min(low[1], v), high[1] = std::max(high[1], v);
    }
    if (z_high <= 0.0f) return Place::kOutside;
    if (z_low < 0.5f * view_.voxel) return Place::kNear;  // the corners' pixels bound nothing
    const int size[2] = {lens.width, lens.height};
    int from[2], to[2];
    for (int axis = 0; axis < 2; ++axis) {
      constexpr float kSlack = 0.01f;  // pixels, for rounding
      const auto last = static_cast<float>(size[axis] - 1);
      if (high[axis] < -kSlack || low[axis] > last + 1.0f + kSlack) return Place::kOutside;
      from[axis] = static_cast<int>(std::clamp(low[axis] - kSlack, 0.0f, last));
      to[axis] = static_cast<int>(std::clamp(high[axis] + kSlack, 0.0f, last));
    }
    const Measured measured = tiles_.within(from, to);
    if (!(z_low - measured.furthest <= 2.0f * view_.truncation)) return Place::kBehind;
    const float room = measured.nearest - z_high - 2.0f * view_.truncation;
    return room * measured.least_slope > view_.clear ? Place::kBefore : Place::kNear;
  }

  Projector projector_;
  Tiles tiles_;
  FusedView view_;
  Vec corners_[8];
};

}  // namespace

void fuse_view(const Lattice& lattice, const std::int32_t* blocks, std::size_t count, const DepthView& view,
               int wanted, float* sums) {
  const Fuser fuser(lattice, view, wanted);
  parallel_for(count, 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t b = begin; b < end; ++b)
      fuser.block(blocks + 3 * b, sums + b * kBlockVoxels, count * kBlockVoxels);
  });
}

}  // namespace goc
