#include "plane_normals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "threads.hpp"

namespace goc {
namespace {

// Normal equations of q = a·u + b·v + c over the pixels near one: on a plane inverse depth is linear in the pixel.
struct PlaneFit {
  float n = 0, u = 0, v = 0, uu = 0, uv = 0, vv = 0, q = 0, uq = 0, vq = 0;

  void add(float du, float dv, float value) {
    n += 1, u += du, v += dv, uu += du * du, uv += du * dv, vv += dv * dv;
    q += value, uq += du * value, vq += dv * value;
  }

  // False where the pixels lie on one line.
  bool solve(float& a, float& b, float& c) const {
    const float suu = uu - u * u / n, suv = uv - u * v / n, svv = vv - v * v / n;
    const float suq = uq - u * q / n, svq = vq - v * q / n, det = suu * svv - suv * suv;
    if (det < 1e-3f * n * n) return false;
    a = (suq * svv - svq * suv) / det;
    b = (svq * suu - suq * suv) / det;
    c = (q - a * u - b * v) / n;
    return true;
  }
};

void pixel_normal(const DepthImage& image, int x, int y, int radius, float agree, int fewest, float* out) {
  out[0] = out[1] = out[2] = std::numeric_limits<float>::quiet_NaN();
  const float z = image.depth[static_cast<std::size_t>(y) * image.width + x];
  if (!(z > 0)) return;
  PlaneFit fit;
  for (int v = std::max(0, y - radius); v <= std::min(image.height - 1, y + radius); ++v)
    for (int u = std::max(0, x - radius); u <= std::min(image.width - 1, x + radius); ++u) {
      const float other = image.depth[static_cast<std::size_t>(v) * image.width + u];
      // Relative to this pixel's inverse depth, or the sums would drown the differences.
      if (std::abs(other - z) <= agree * z)
        fit.add(static_cast<float>(u - x), static_cast<float>(v - y), (z - other) / other);
    }
  float a, b, c;
  if (fit.n < static_cast<float>(fewest) || !fit.solve(a, b, c)) return;
  // z/depth = 1 + c + a·du + b·dv; in ray coordinates that is the plane's normal over its distance.
  const float nx = a * image.fx, ny = b * image.fy;
  const float nz = 1.0f + c - a * (x + 0.5f - image.cx) - b * (y + 0.5f - image.cy);
  const float scale = -1.0f / std::sqrt(nx * nx + ny * ny + nz * nz);
  out[0] = nx * scale, out[1] = ny * scale, out[2] = nz * scale;
}

}  // namespace

void plane_normals(const DepthImage& image, int radius, float agree, int fewest, float* normals) {
  parallel_for(image.height, 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y)
      for (int x = 0; x < image.width; ++x)
        pixel_normal(image, x, static_cast<int>(y), radius, agree, fewest, normals + 3 * (y * image.width + x));
  });
}

}  // namespace goc
