#include "fuse.hpp"

#include <algorithm>
#include <cmath>

#include "threads.hpp"

namespace goc {
namespace {

struct Vec {
  float x, y, z;
  Vec operator+(Vec o) const { return {x + o.x, y + o.y, z + o.z}; }
  Vec operator*(float s) const { return {x * s, y * s, z * s}; }
};

// A view in the units the inner loop wants.
class Projector {
 public:
  Projector(const Lattice& lattice, const DepthView& view) : view_(view) {
    const double* m = view.cam_from_world;
    for (int row = 0; row < 3; ++row) {
      const double* r = m + 4 * row;
      base_[row] = r[0] * lattice.origin[0] + r[1] * lattice.origin[1] + r[2] * lattice.origin[2] + r[3];
      for (int axis = 0; axis < 3; ++axis) step_[axis][row] = r[axis] * lattice.voxel;
    }
    fx_ = static_cast<float>(view.focal[0]), fy_ = static_cast<float>(view.focal[1]);
    cx_ = static_cast<float>(view.centre[0]), cy_ = static_cast<float>(view.centre[1]);
  }

  // Camera-space position of a voxel; double, because it is the start of a block's increments.
  Vec at(std::int64_t i, std::int64_t j, std::int64_t k) const {
    double p[3];
    for (int row = 0; row < 3; ++row)
      p[row] = base_[row] + static_cast<double>(i) * step_[0][row] + static_cast<double>(j) * step_[1][row] +
               static_cast<double>(k) * step_[2][row];
    return {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
  }

  Vec step(int axis) const {
    return {static_cast<float>(step_[axis][0]), static_cast<float>(step_[axis][1]),
            static_cast<float>(step_[axis][2])};
  }

  // Could any point of this ball be in the image?
  bool sees(Vec c, float radius) const {
    if (c.z < -radius) return false;
    const float right = (static_cast<float>(view_.width) - cx_), down = (static_cast<float>(view_.height) - cy_);
    return outside(fx_ * c.x - right * c.z, fx_, right) <= radius && outside(-fx_ * c.x - cx_ * c.z, fx_, cx_) <= radius &&
           outside(fy_ * c.y - down * c.z, fy_, down) <= radius && outside(-fy_ * c.y - cy_ * c.z, fy_, cy_) <= radius;
  }

  // Pixels and depths of a row of voxels, -1 outside the image. Plain loops over arrays: the compiler vectorises them.
  struct Row {
    float u[kBlockEdge], v[kBlockEdge], z[kBlockEdge];
    int pixel[kBlockEdge];
  };

  void project(Vec first, Vec step, Row& row) const {
    const float right = static_cast<float>(view_.width), bottom = static_cast<float>(view_.height);
    for (int c = 0; c < kBlockEdge; ++c) {
      const float t = static_cast<float>(c), z = first.z + step.z * t, scale = 1.0f / z;
      const float u = fx_ * ((first.x + step.x * t) * scale) + cx_, v = fy_ * ((first.y + step.y * t) * scale) + cy_;
      const bool inside = (z > 0.0f) & (u >= 0.0f) & (v >= 0.0f) & (u < right) & (v < bottom);
      row.u[c] = u, row.v[c] = v, row.z[c] = z;
      row.pixel[c] = inside ? static_cast<int>(v) * view_.width + static_cast<int>(u) : -1;
    }
  }

 private:
  static float outside(float signed_value, float a, float b) { return signed_value / std::sqrt(a * a + b * b); }

  const DepthView& view_;
  double base_[3], step_[3][3];
  float fx_, fy_, cx_, cy_;
};

// Depth along the ray through (u, v): bilinear where the four pixels round it are one surface, else the nearest.
float sample_depth(const DepthView& view, float u, float v, int nearest, float agree) {
  const int x = static_cast<int>(std::floor(u - 0.5f)), y = static_cast<int>(std::floor(v - 0.5f));
  const float centre = view.depth[nearest];
  if (x < 0 || y < 0 || x + 1 >= view.width || y + 1 >= view.height) return centre;
  const std::size_t first = static_cast<std::size_t>(y) * view.width + x, below = first + view.width;
  const float a = view.depth[first], b = view.depth[first + 1], c = view.depth[below], d = view.depth[below + 1];
  const float low = std::min(std::min(a, b), std::min(c, d)), high = std::max(std::max(a, b), std::max(c, d));
  if (!(high - low <= agree) || std::isnan(a + b + c + d)) return centre;
  if (view.ids) {
    const std::int16_t id = view.ids[nearest];
    if (view.ids[first] != id || view.ids[first + 1] != id || view.ids[below] != id || view.ids[below + 1] != id)
      return centre;
  }
  const float s = u - 0.5f - static_cast<float>(x), t = v - 0.5f - static_cast<float>(y);
  return (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
}

class Fuser {
 public:
  Fuser(const Lattice& lattice, const DepthView& view, int wanted)
      : view_(view), projector_(lattice, view), wanted_(wanted), truncation_(static_cast<float>(lattice.truncation)),
        voxel_(static_cast<float>(lattice.voxel)), radius_(static_cast<float>(lattice.voxel) * kBlockEdge * 0.87f),
        reach_(2.0f * truncation_) {}

  void block(const std::int32_t* coords, float* sums) const {
    const std::int64_t i = std::int64_t{coords[0]} * kBlockEdge, j = std::int64_t{coords[1]} * kBlockEdge,
                       k = std::int64_t{coords[2]} * kBlockEdge;
    const Vec first = projector_.at(i, j, k), dx = projector_.step(0), dy = projector_.step(1), dz = projector_.step(2);
    const float half = 0.5f * (kBlockEdge - 1);
    if (!projector_.sees(first + (dx + dy + dz) * half, radius_)) return;
    Projector::Row pixels;
    for (int a = 0; a < kBlockEdge; ++a) {
      for (int b = 0; b < kBlockEdge; ++b) {
        const Vec row = first + dx * static_cast<float>(a) + dy * static_cast<float>(b);
        projector_.project(row, dz, pixels);
        for (int c = 0; c < kBlockEdge; ++c, sums += kSums)
          if (pixels.pixel[c] >= 0) voxel(pixels.u[c], pixels.v[c], pixels.z[c], pixels.pixel[c], sums);
      }
    }
  }

 private:
  void voxel(float u, float v, float z, int pixel, float* sum) const {
    const float nearest = view_.depth[pixel], slope = view_.slope[pixel];
    // Further behind along the ray, an oblique tangent plane would speak for places that its surface never gets to.
    if (std::isnan(slope) || z - nearest > reach_) return;
    const float depth = sample_depth(view_, u, v, pixel, 2.0f * truncation_), weight = slope / (z * z);
    // The distance to the tangent plane, not along the ray: views from all sides then mean the same thing.
    const float distance = (depth - z) * slope;
    const bool own = !view_.ids || view_.ids[pixel] == wanted_;
    if (distance > 0.5f * voxel_ && (!own || depth - z > truncation_)) sum[kEmpty] += weight;
    if (distance < -truncation_ || distance > truncation_) return;
    // Behind the surface trust fades: what is there may be the far side of something thin.
    const float faded = weight * std::min(1.0f, (truncation_ + distance) / (truncation_ - voxel_));
    if (!own) {
      if (view_.ids[pixel] >= 0) sum[kOther] += faded;
      return;
    }
    sum[kDistance] += faded * distance;
    sum[kWeight] += faded;
    sum[kViews] += 1.0f;
    const std::uint8_t* rgb = view_.colours + 3 * pixel;
    for (int c = 0; c < 3; ++c) sum[kRed + c] += faded * static_cast<float>(rgb[c]);
  }

  const DepthView& view_;
  Projector projector_;
  int wanted_;
  float truncation_, voxel_, radius_, reach_;
};

}  // namespace

void fuse_view(const Lattice& lattice, const std::int32_t* blocks, std::size_t count, const DepthView& view,
               int wanted, float* sums) {
  const Fuser fuser(lattice, view, wanted);
  parallel_for(count, 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t b = begin; b < end; ++b)
      fuser.block(blocks + 3 * b, sums + b * static_cast<std::size_t>(kBlockVoxels) * kSums);
  });
}

}  // namespace goc
