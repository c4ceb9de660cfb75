#include "register.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace goc {
namespace {

constexpr float kDark = 0.02f, kBright = 0.97f;  // beyond, a photograph says nothing of exposure
constexpr int kFewest = 60;                      // points that a comparison of grey takes
constexpr int kRounds = 3;                       // of reweighting gain and offset

struct Shade {
  float own, seen;   // grey of the surface and of the target
  float cx, cy, cz;  // change of the target's grey as the point moves
  float x, y, z;
};

void add(double* out, const double* a, double r, double weight) {
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) out[6 * i + j] += weight * a[i] * a[j];
    out[36 + i] += weight * a[i] * r;
  }
  out[42] += 1.0;
  out[43] += std::abs(r);
}

// d(direction · point) as the point turns and shifts.
void lever(double* a, double x, double y, double z, double nx, double ny, double nz) {
  a[0] = y * nz - z * ny, a[1] = z * nx - x * nz, a[2] = x * ny - y * nx;
  a[3] = nx, a[4] = ny, a[5] = nz;
}

// Grey between four pixels and its slope along x and y.
void between_pixels(const float* grey, int width, float u, float v, float* value, float* along_x, float* along_y) {
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  const float s = u - x, t = v - y;
  const float* g = grey + static_cast<std::size_t>(y) * width + x;
  *value = (1 - t) * ((1 - s) * g[0] + s * g[1]) + t * ((1 - s) * g[width] + s * g[width + 1]);
  *along_x = (1 - t) * (g[1] - g[0]) + t * (g[width + 1] - g[width]);
  *along_y = (1 - s) * (g[width] - g[0]) + s * (g[width + 1] - g[1]);
}

// Gain and offset by weighted least squares, reweighted; returns the scale of what is left.
double fit_grey(const std::vector<Shade>& shades, double* gain, double* offset) {
  *gain = 1.0, *offset = 0.0;
  double scale = 1e3;
  for (int round = 0; round < kRounds; ++round) {
    double w = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const Shade& s : shades) {
      const double r = (s.seen - *gain * s.own - *offset) / (2 * scale), weight = 1 / ((1 + r * r) * (1 + r * r));
      w += weight, x += weight * s.own, y += weight * s.seen, xx += weight * s.own * s.own, xy += weight * s.own * s.seen;
    }
    const double spread = xx - x * x / w;
    *gain = spread > 1e-6 * w ? std::clamp((xy - x * y / w) / spread, 0.25, 4.0) : 1.0;
    *offset = (y - *gain * x) / w;
    double sum = 0;
    for (const Shade& s : shades) sum += std::min(std::abs(s.seen - *gain * s.own - *offset), 3 * scale);
    scale = std::max(1.25 * sum / shades.size(), 2e-3);
  }
  return scale;
}

}  // namespace

void register_surface(const Surface& surface, const Camera& seen_from, const Target& target, const RegisterLimits& limits,
                      double* out) {
  std::fill(out, out + kRegisterSums, 0.0);
  float rows[12];
  between(seen_from, target.camera, rows);
  const Lens lens = target.camera.lens();
  std::vector<Shade> shades;
  shades.reserve(surface.count);
  for (int i = 0; i < surface.count; ++i) {
    const float *p = surface.points + 3 * i, *n = surface.normals + 3 * i;
    const float x = rows[0] * p[0] + rows[1] * p[1] + rows[2] * p[2] + rows[3];
    const float y = rows[4] * p[0] + rows[5] * p[1] + rows[6] * p[2] + rows[7];
    const float z = rows[8] * p[0] + rows[9] * p[1] + rows[10] * p[2] + rows[11];
    if (!(z > 1e-6f)) continue;
    const float u = x / z * lens.fx + lens.cx - 0.5f, v = y / z * lens.fy + lens.cy - 0.5f;
    if (!(u >= 0 && v >= 0 && u < lens.width - 1 && v < lens.height - 1)) continue;
    const int column = static_cast<int>(u + 0.5f), row = static_cast<int>(v + 0.5f);
    const std::size_t pixel = static_cast<std::size_t>(row) * lens.width + column;
    const float depth = target.depth[pixel];
    const float* m = target.normals + 3 * pixel;
    const float nx = rows[0] * n[0] + rows[1] * n[1] + rows[2] * n[2], ny = rows[4] * n[0] + rows[5] * n[1] + rows[6] * n[2],
                nz = rows[8] * n[0] + rows[9] * n[1] + rows[10] * n[2];
    if (!(nx * m[0] + ny * m[1] + nz * m[2] >= limits.cosine)) continue;  // NaN is no normal
    const float qx = (column + 0.5f - lens.cx) / lens.fx * depth, qy = (row + 0.5f - lens.cy) / lens.fy * depth;
    const double gap = (x - qx) * m[0] + (y - qy) * m[1] + (z - depth) * m[2];
    if (!(std::abs(gap) <= limits.reach)) continue;
    double a[6];
    lever(a, x, y, z, m[0], m[1], m[2]);
    const double sigma = limits.noise + limits.noise_square * z * z, far = 2 * gap / limits.reach;
    add(out, a, gap, 1 / ((1 + far * far) * (1 + far * far) * sigma * sigma));
    float grey, gx, gy;
    between_pixels(target.grey, lens.width, u, v, &grey, &gx, &gy);
    if (grey < kDark || grey > kBright || surface.grey[i] < kDark || surface.grey[i] > kBright) continue;
    const float jx = gx * lens.fx / z, jy = gy * lens.fy / z;
    shades.push_back({surface.grey[i], grey, jx, jy, -(jx * x + jy * y) / z, x, y, z});
  }
  double* last = out + 2 * kRegisterTerms;
  last[0] = 1.0;
  if (static_cast<int>(shades.size()) < kFewest) return;
  const double scale = fit_grey(shades, &last[0], &last[1]);
  for (const Shade& s : shades) {
    const double r = s.seen - last[0] * s.own - last[1], far = r / (2 * scale);
    double a[6];
    lever(a, s.x, s.y, s.z, s.cx, s.cy, s.cz);
    add(out + kRegisterTerms, a, r, 1 / ((1 + far * far) * (1 + far * far) * scale * scale));
  }
}

}  // namespace goc
