// How well photographs match: warped rows, windows, smoothing paths and slanted patches. Plain loops, which the
// compiler vectorises.
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {
namespace {

// Bilinear grey at (u, v), clamped to the photograph; NaN counts as 0.
GOC_INLINE float sample(const std::uint32_t* quads, int stride, float last_x, float last_y, float u, float v) {
  u = u > 0.0f ? u : 0.0f;
  v = v > 0.0f ? v : 0.0f;
  u = u < last_x ? u : last_x;
  v = v < last_y ? v : last_y;
  const int x = static_cast<int>(u), y = static_cast<int>(v);
  const float along = u - static_cast<float>(x), down = v - static_cast<float>(y);
  const std::uint32_t quad = quads[y * stride + x];
  const float a = static_cast<float>(static_cast<int>(quad & 255u));
  const float b = static_cast<float>(static_cast<int>((quad >> 8) & 255u));
  const float c = static_cast<float>(static_cast<int>((quad >> 16) & 255u));
  const float d = static_cast<float>(static_cast<int>(quad >> 24));
  const float above = a + along * (b - a), below = c + along * (d - c);
  return above + down * (below - above);
}

// Half a pixel beyond the outermost centres is still inside.
GOC_INLINE float is_inside(float z, float u, float v, float last_x, float last_y) {
  const bool in = (z > 0.0f) & (u > -0.5f) & (v > -0.5f) & (u < last_x + 0.5f) & (v < last_y + 0.5f);
  return in ? 1.0f : 0.0f;
}

}  // namespace

void warp_row(const WarpedRow& warp, int width, float* __restrict greys, float* __restrict inside) {
  const WarpedRow w = warp;
  for (int i = 0; i < width; ++i) {
    const float at = static_cast<float>(i);
    const float z = w.start[2] + at * w.step[2], over = 1.0f / z;
    const float u = (w.start[0] + at * w.step[0]) * over, v = (w.start[1] + at * w.step[1]) * over;
    greys[i] = sample(w.quads, w.stride, w.last_x, w.last_y, u, v);
    inside[i] = is_inside(z, u, v, w.last_x, w.last_y);
  }
}

void match_row(const float* const* rows, const float* const* warped, const float* __restrict mean,
               const float* __restrict scale, const float* __restrict inside, int width, float* __restrict scratch,
               float* __restrict costs) {
  constexpr int kSide = 2 * kWindow + 1;
  constexpr float kShare = 1.0f / (kSide * kSide);
  const int padded = width + 2 * kWindow;
  float* __restrict s = scratch + kWindow;
  float* __restrict ss = s + padded;
  float* __restrict st = ss + padded;
  static_assert(kSide == 5, "the rows are written out");
  const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4];
  const float *f = warped[0], *g = warped[1], *h = warped[2], *k = warped[3], *l = warped[4];
  for (int i = 0; i < width; ++i) {
    s[i] = f[i] + g[i] + h[i] + k[i] + l[i];
    ss[i] = f[i] * f[i] + g[i] * g[i] + h[i] * h[i] + k[i] * k[i] + l[i] * l[i];
    st[i] = f[i] * a[i] + g[i] * b[i] + h[i] * c[i] + k[i] * d[i] + l[i] * e[i];
  }
  float* const all[] = {s, ss, st};
  for (float* sums : all)
    for (int i = 1; i <= kWindow; ++i) sums[-i] = sums[0], sums[width - 1 + i] = sums[width - 1];
  for (int i = 0; i < width; ++i) {
    const float m = kShare * (s[i - 2] + s[i - 1] + s[i] + s[i + 1] + s[i + 2]);
    const float mm = kShare * (ss[i - 2] + ss[i - 1] + ss[i] + ss[i + 1] + ss[i + 2]);
    const float mt = kShare * (st[i - 2] + st[i - 1] + st[i] + st[i + 1] + st[i + 2]);
    const float spread = mm - m * m, variance = spread > 0.0f ? spread : 0.0f;
    const float likeness = (mt - m * mean[i]) * scale[i] / __builtin_sqrtf(variance + kGreyNoise * kGreyNoise);
    const float counted = inside[i] * (likeness > 0.0f ? likeness : 0.0f);
    costs[i] = counted < 1.0f ? 1.0f - counted : 0.0f;
  }
}

void keep_best(const float* __restrict costs, int width, float* __restrict first, float* __restrict second,
               float* __restrict third) {
  for (int i = 0; i < width; ++i) {
    const float x = costs[i];
    const float a = first[i] < x ? first[i] : x, left = first[i] < x ? x : first[i];
    const float b = second[i] < left ? second[i] : left, rest = second[i] < left ? left : second[i];
    first[i] = a;
    second[i] = b;
    third[i] = third[i] < rest ? third[i] : rest;
  }
}

float path_step(const float* costs, const float* before, float best_before, float step, float jump, int planes,
                float* now, float* total) {
  const Lanes floor = splat(best_before + jump);
  Lanes best = splat(1e9f);
  for (int i = 0; i < planes; i += 16) {
    const Lanes beside = min(load(before + i - 1), load(before + i + 1)) + step;
    const Lanes reached = min(min(load(before + i), beside), floor) - best_before + load(costs + i);
    store(now + i, reached);
    store(total + i, load(total + i) + reached);
    best = min(best, reached);
  }
  float lanes[16], least = 1e9f;
  store(lanes, best);
  for (const float x : lanes) least = x < least ? x : least;
  return least;
}

void patch_costs(const Patches& patches, const Target& target, const float* __restrict q, const float* __restrict gx,
                 const float* __restrict gy, float* __restrict costs) {
  const Target to = target;
  float start[3][kPatchLanes], along[3][kPatchLanes], down[3][kPatchLanes];
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < kPatchLanes; ++i) {
      start[k][i] = to.m[3 * k] * patches.x[i] + to.m[3 * k + 1] * patches.y[i] + to.m[3 * k + 2] + q[i] * to.t[k];
      along[k][i] = to.m[3 * k] + gx[i] * to.t[k];
      down[k][i] = to.m[3 * k + 1] + gy[i] * to.t[k];
    }
  float m[kPatchLanes] = {}, mm[kPatchLanes] = {}, mt[kPatchLanes] = {};
  for (int sample_index = 0; sample_index < kPatchSamples; ++sample_index) {
    const float dx = kPatchSpacing * (sample_index % kPatchSide - 0.5f * (kPatchSide - 1));
    const float dy = kPatchSpacing * (sample_index / kPatchSide - 0.5f * (kPatchSide - 1));
    const float* __restrict weight = patches.weight[sample_index];
    const float* __restrict grey = patches.grey[sample_index];
    for (int i = 0; i < kPatchLanes; ++i) {
      const float over = 1.0f / (start[2][i] + dx * along[2][i] + dy * down[2][i]);
      const float u = (start[0][i] + dx * along[0][i] + dy * down[0][i]) * over;
      const float v = (start[1][i] + dx * along[1][i] + dy * down[1][i]) * over;
      const float x = sample(to.quads, to.stride, to.last_x, to.last_y, u, v), weighted = weight[i] * x;
      m[i] += weighted;
      mm[i] += weighted * x;
      mt[i] += weighted * grey[i];
    }
  }
  for (int i = 0; i < kPatchLanes; ++i) {
    const float over = 1.0f / start[2][i], u = start[0][i] * over, v = start[1][i] * over;
    const float spread = mm[i] - m[i] * m[i], variance = spread > 0.0f ? spread : 0.0f;
    const float likeness =
        (mt[i] - m[i] * patches.mean[i]) * patches.scale[i] / __builtin_sqrtf(variance + kGreyNoise * kGreyNoise);
    const float counted = is_inside(start[2][i], u, v, to.last_x, to.last_y) * (likeness > 0.0f ? likeness : 0.0f);
    costs[i] = counted < 1.0f ? 1.0f - counted : 0.0f;
  }
}

}  // namespace goc::GOC_ISA
