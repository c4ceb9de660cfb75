#include "geometry_loss.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "threads.hpp"

namespace goc {
namespace {

constexpr float kMinAlpha = 0.1f;         // below, nothing worth a depth was rendered
constexpr float kMinDenominator = 0.01f;  // below, planes are seen edge-on
constexpr std::size_t kRowGrain = 16;

struct Vec3 {
  float x, y, z;
};
Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec3 cross(Vec3 a, Vec3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }

}  // namespace

GeometryLosses GeometryLoss::operator()(const DepthView& view, float depth_weight, float normal_weight,
                                        float* numerator_grad, float* denominator_grad) {
  const int w = view.width, h = view.height;
  const std::size_t size = (std::size_t)w * h;
  const bool with_normals = view.prior_normals && normal_weight != 0.0f && w > 2 && h > 2;
  depth_.resize(size);
  sums_.assign((std::size_t)h * 4, 0.0);  // a row: Σ|D − D̂|, count, Σ α(1 − cos), count
  const auto ray = [&](int x, int y) -> Vec3 {
    return {(x + 0.5f - view.cx) / view.fx, (y + 0.5f - view.cy) / view.fy, 1.0f};
  };
  const auto point = [&](int x, int y) -> Vec3 {
    const float d = depth_[(std::size_t)y * w + x];
    const Vec3 r = ray(x, y);
    return {r.x * d, r.y * d, d};
  };
  parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * w; i < end * w; ++i) {
      // NaN where nothing was rendered: it spreads to every difference that would need the pixel.
      const bool rendered = view.alpha[i] > kMinAlpha && view.denominator[i] > kMinDenominator;
      depth_[i] = rendered ? view.numerator[i] / view.denominator[i] : std::numeric_limits<float>::quiet_NaN();
      if (!rendered || !std::isfinite(view.prior_depth[i])) continue;
      sums_[i / w * 4] += std::fabs(depth_[i] - view.prior_depth[i]);
      sums_[i / w * 4 + 1] += 1.0;
    }
  });
  if (with_normals) {
    pull_x_.assign(size * 3, 0.0f);
    pull_y_.assign(size * 3, 0.0f);
    parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
      for (int y = std::max(1, (int)begin); y < std::min(h - 1, (int)end); ++y)
        for (int x = 1; x < w - 1; ++x) {
          const std::size_t i = (std::size_t)y * w + x;
          const float* n = view.prior_normals + 3 * i;
          if (!std::isfinite(n[0]) || !std::isfinite(depth_[i])) continue;
          const Vec3 right = point(x + 1, y) - point(x - 1, y), down = point(x, y + 1) - point(x, y - 1);
          const Vec3 c = cross(down, right);
          const float length = std::sqrt(dot(c, c));
          if (!(length > 1e-12f)) continue;  // degenerate, or NaN: a neighbour was not rendered
          const Vec3 prior{n[0], n[1], n[2]}, unit{c.x / length, c.y / length, c.z / length};
          const float cosine = dot(unit, prior), weight = view.alpha[i];
          sums_[(std::size_t)y * 4 + 2] += weight * (1.0f - cosine);
          sums_[(std::size_t)y * 4 + 3] += 1.0;
          // d(−α cos)/dc, then through c = down × right.
          const float f = -weight / length;
          const Vec3 g{f * (prior.x - cosine * unit.x), f * (prior.y - cosine * unit.y), f * (prior.z - cosine * unit.z)};
          const Vec3 gx = cross(g, down), gy = cross(right, g);
          std::memcpy(&pull_x_[3 * i], &gx, sizeof gx);
          std::memcpy(&pull_y_[3 * i], &gy, sizeof gy);
        }
    });
  }
  double sum[4] = {};
  for (int y = 0; y < h; ++y)
    for (int k = 0; k < 4; ++k) sum[k] += sums_[(std::size_t)y * 4 + k];
  const float depth_scale = depth_weight / (float)std::max(sum[1], 1.0);
  const float normal_scale = normal_weight / (float)std::max(sum[3], 1.0);
  parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (int y = (int)begin; y < (int)end; ++y)
      for (int x = 0; x < w; ++x) {
        const std::size_t i = (std::size_t)y * w + x;
        numerator_grad[i] = denominator_grad[i] = 0.0f;
        if (!std::isfinite(depth_[i])) continue;
        float g = 0.0f;
        const float difference = depth_[i] - view.prior_depth[i];
        if (std::isfinite(difference)) g = difference > 0 ? depth_scale : (difference < 0 ? -depth_scale : 0.0f);
        if (with_normals) {
          Vec3 pull{0, 0, 0};
          const auto add = [&](const std::vector<float>& from, std::size_t at, float sign) {
            pull.x += sign * from[3 * at], pull.y += sign * from[3 * at + 1], pull.z += sign * from[3 * at + 2];
          };
          if (x > 0) add(pull_x_, i - 1, 1.0f);
          if (x < w - 1) add(pull_x_, i + 1, -1.0f);
          if (y > 0) add(pull_y_, i - w, 1.0f);
          if (y < h - 1) add(pull_y_, i + w, -1.0f);
          g += normal_scale * dot(pull, ray(x, y));
        }
        numerator_grad[i] = g / view.denominator[i];
        denominator_grad[i] = -g * depth_[i] / view.denominator[i];
      }
  });
  return {sum[0] / std::max(sum[1], 1.0), sum[2] / std::max(sum[3], 1.0)};
}

}  // namespace goc
