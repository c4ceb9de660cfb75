// Rows of Eq. (5): SSIM in 3×3 blocks and its gradient; see ../block_ssim.hpp.
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {
namespace {

constexpr float kShare = 0.85f;  // λ of Eq. (5)
constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;

GOC_INLINE Lanes mean_of_three(const float* column) {
  return (load(column - 1) + load(column) + load(column + 1)) * (1.0f / 9.0f);
}

// What a block of sixteen pixels does to the five sums of their columns.
struct Ssim {
  Lanes value, by_mean, by_square, by_product;
};
GOC_INLINE Ssim ssim_of(const float* columns, int width, Lanes counted) {
  const Lanes mx = mean_of_three(columns), my = mean_of_three(columns + width);
  const Lanes xx = mean_of_three(columns + 2 * width), yy = mean_of_three(columns + 3 * width);
  const Lanes xy = mean_of_three(columns + 4 * width);
  const Lanes a1 = mx * my * 2.0f + kC1, a2 = (xy - mx * my) * 2.0f + kC2;
  const Lanes b1 = mx * mx + my * my + kC1, b2 = (xx - mx * mx) + (yy - my * my) + kC2;
  const Lanes inverse = counted / (b1 * b2), found = a1 * a2 * inverse;
  const Lanes d_a1 = a2 * inverse, d_a2 = a1 * inverse;
  const Lanes d_b1 = splat(0.0f) - found / b1, d_b2 = splat(0.0f) - found / b2;
  return {found, (my * (d_a1 - d_a2) + mx * (d_b1 - d_b2)) * 2.0f, d_b2, d_a2 * 2.0f};
}

GOC_INLINE Lanes magnitude(Lanes x) { return max(x, splat(0.0f) - x); }

}  // namespace

void block_columns(const float* __restrict x, const float* __restrict y, int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) {
    const float a = x[i - width], b = x[i], c = x[i + width], d = y[i - width], e = y[i], f = y[i + width];
    out[i] = a + b + c;
    out[i + width] = d + e + f;
    out[i + 2 * width] = a * a + b * b + c * c;
    out[i + 3 * width] = d * d + e * e + f * f;
    out[i + 4 * width] = a * d + b * e + c * f;
  }
}

float block_row(const float* columns, const float* counted, const float* x, const float* y, int width, float* by_mean,
                float* by_square, float* by_product) {
  Lanes total = splat(0.0f);
  for (int i = 1; i < width - 1; i += 16) {
    const int left = width - 1 - i, count = left < 16 ? left : 16;
    const Lanes own = load_some(counted + i, count);
    const Lanes away = magnitude(load_some(x + i, count) - load_some(y + i, count));
    const Ssim found = ssim_of(columns + i, width, own);
    total = total + own * (away * (1 - kShare) + kShare / 2) - keep(own > splat(0.0f), found.value) * (kShare / 2);
    store_some(by_mean + i, count, found.by_mean);
    store_some(by_square + i, count, found.by_square);
    store_some(by_product + i, count, found.by_product);
  }
  return sum(total);
}

void block_grad_row(const float* const* columns, const float* x, const float* y, const float* counted, int width,
                    float* out) {
  for (int i = 0; i < width; i += 16) {
    const int left = width - i, count = left < 16 ? left : 16;
    const Lanes a = load_some(x + i, count), b = load_some(y + i, count);
    const Lanes ssim = mean_of_three(columns[0] + i) + a * mean_of_three(columns[1] + i) * 2.0f +
                       b * mean_of_three(columns[2] + i);
    const Lanes sign = keep(a > b, splat(1.0f)) - keep(b > a, splat(1.0f));
    const Lanes own = load_some(counted + i, count);
    store_some(out + i, count, (own * sign * (1 - kShare) - ssim * (kShare / 2)) * (1.0f / 3.0f));
  }
}

}  // namespace goc::GOC_ISA
