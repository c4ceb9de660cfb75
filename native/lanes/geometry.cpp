// Rows of L_d and L_dn on a rendered depth, and of the fraction behind a depth of planes.
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {
namespace {

constexpr float kMinAlpha = 0.1f;         // below, nothing worth a depth was rendered
constexpr float kMinDenominator = 0.01f;  // below, planes are seen edge-on

GOC_INLINE Mask number(Lanes x) { return x == x; }
GOC_INLINE Lanes count_of(Mask m) { return keep(m, splat(1.0f)); }
GOC_INLINE Lanes dot(const Lanes* a, const Lanes* b) { return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2])); }
GOC_INLINE void cross(const Lanes* a, const Lanes* b, Lanes* out) {
  out[0] = a[1] * b[2] - a[2] * b[1], out[1] = a[2] * b[0] - a[0] * b[2], out[2] = a[0] * b[1] - a[1] * b[0];
}

}  // namespace

void depth_row(const float* numerator, const float* denominator, const float* alpha, const float* prior, int width,
               float* depth, float* sums) {
  Lanes distance = splat(0.0f), count = splat(0.0f);
  for (int i = 0; i < width; i += 16) {
    const Lanes below = load(denominator + i);
    const Mask shown = (load(alpha + i) > splat(kMinAlpha)) & (below > splat(kMinDenominator)) &
                       (load(kIota) <= (float)(width - i) - 1.0f);
    const Lanes d = load(numerator + i) / below;
    store(depth + i, select(shown, d, splat(__builtin_nanf(""))));
    const Lanes difference = d - load(prior + i);
    const Mask known = shown & number(difference - difference);  // neither NaN nor infinite
    distance = distance + keep(known, max(difference, splat(0.0f) - difference));
    count = count + count_of(known);
  }
  sums[0] = sum(distance), sums[1] = sum(count);
}

void normal_row(const NormalRow& row, int width, float* const* out, float* sums) {
  Lanes distance = splat(0.0f), count = splat(0.0f);
  const Lanes ray_y = splat(row.ray_y), ray_up = splat(row.ray_y - row.step_y), ray_down = splat(row.ray_y + row.step_y);
  for (int i = 0; i < width; i += 16) {
    const Lanes ray_x = load(kIota) * row.step_x + (row.first_x + i * row.step_x);
    const Lanes ray_left = ray_x - row.step_x, ray_right = ray_x + row.step_x;
    const Lanes left = load(row.depth + i - 1), right = load(row.depth + i + 1);
    const Lanes up = load(row.above + i), down = load(row.below + i);
    const Lanes across[3] = {ray_right * right - ray_left * left, ray_y * (right - left), right - left};
    const Lanes along[3] = {ray_x * (down - up), ray_down * down - ray_up * up, down - up};
    Lanes normal[3];
    cross(along, across, normal);
    const Lanes squared = dot(normal, normal);
    const Lanes prior[3] = {load(row.normal[0] + i), load(row.normal[1] + i), load(row.normal[2] + i)};
    // Not where a neighbour was not rendered (NaN) or all lie on a line.
    const Mask known = (squared > splat(1e-24f)) & number(load(row.depth + i)) & number(prior[0]);
    const Lanes inverse = splat(1.0f) / sqrt(squared);
    for (int k = 0; k < 3; ++k) normal[k] = normal[k] * inverse;
    const Lanes cosine = dot(normal, prior), weight = load(row.alpha + i);
    distance = distance + keep(known, weight * (1.0f - cosine));
    count = count + count_of(known);
    // d(−α cos)/dnormal before it was normalised, then through the cross product.
    const Lanes f = splat(0.0f) - weight * inverse;
    Lanes g[3], g_across[3], g_along[3];
    for (int k = 0; k < 3; ++k) g[k] = f * (prior[k] - cosine * normal[k]);
    cross(g, along, g_across);
    cross(across, g, g_along);
    const Lanes rest_across = fma(g_across[1], ray_y, g_across[2]), rest_along = fma(g_along[0], ray_x, g_along[2]);
    store(out[0] + i, keep(known, fma(g_across[0], ray_right, rest_across)));
    store(out[1] + i, keep(known, splat(0.0f) - fma(g_across[0], ray_left, rest_across)));
    store(out[2] + i, keep(known, fma(g_along[1], ray_down, rest_along)));
    store(out[3] + i, keep(known, splat(0.0f) - fma(g_along[1], ray_up, rest_along)));
  }
  sums[0] = sum(distance), sums[1] = sum(count);
}

void depth_grad_row(const DepthGradRow& row, int width, float* numerator_grad, float* denominator_grad) {
  const Lanes scale = splat(row.depth_scale);
  for (int i = 0; i < width; i += 16) {
    const Lanes depth = load(row.depth + i), difference = depth - load(row.prior + i);
    const Mask known = number(difference - difference);
    Lanes g = keep(known & (difference > splat(0.0f)), scale) - keep(known & (splat(0.0f) > difference), scale);
    if (row.from_left) {
      const Lanes pull = (load(row.from_left + i - 1) + load(row.from_right + i + 1)) +
                         (load(row.from_above + i) + load(row.from_below + i));
      g = fma(pull, row.normal_scale, g);
    }
    const Mask shown = number(depth);
    const Lanes per_denominator = g / load(row.denominator + i);
    store(numerator_grad + i, keep(shown, per_denominator));
    store(denominator_grad + i, keep(shown, splat(0.0f) - per_denominator * depth));
  }
}

void fraction_row(const float* const* plane, float first_x, float step_x, float ray_y, int width, float* numerator,
                  float* denominator) {
  for (int i = 0; i < width; ++i) {
    const float ray_x = first_x + step_x * (float)i;
    numerator[i] = -plane[3][i];
    denominator[i] = -(plane[0][i] * ray_x + plane[1][i] * ray_y + plane[2][i]);
  }
}

void fraction_grad_row(const float* numerator_grad, const float* denominator_grad, float first_x, float step_x,
                       float ray_y, int width, float* const* plane_grad) {
  float *__restrict a = plane_grad[0], *__restrict b = plane_grad[1], *__restrict c = plane_grad[2];
  float* __restrict d = plane_grad[3];
  for (int i = 0; i < width; ++i) {
    const float g = -denominator_grad[i];
    a[i] = g * (first_x + step_x * (float)i), b[i] = g * ray_y, c[i] = g, d[i] = -numerator_grad[i];
  }
}

}  // namespace goc::GOC_ISA
