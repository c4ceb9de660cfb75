// Rows of L_c: the moments of SSIM's window, SSIM itself, and the gradient.
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {
namespace {

// exp(-(k − 5)² / (2·1.5²)), normalised; symmetric.
const float kTaps[kSsimRadius + 1] = {0.00102838f, 0.00759876f, 0.03600077f, 0.10936069f, 0.21300554f, 0.26601173f};
constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;

// Σ_k taps[k]·rows[k][at + offset]: one moment's column.
GOC_INLINE Lanes column(const float* const* rows, int at) {
  Lanes total = load(rows[kSsimRadius] + at) * kTaps[kSsimRadius];
  for (int k = 0; k < kSsimRadius; ++k)
    total = fma(load(rows[k] + at) + load(rows[2 * kSsimRadius - k] + at), kTaps[k], total);
  return total;
}

GOC_INLINE Lanes first_lanes(int count, Lanes x) { return keep(load(kIota) <= count - 1.0f, x); }

}  // namespace

void moments_row(const float* x, const float* y, int pitch, float* out) {
  for (int i = 0; i < pitch; i += 16) {
    const float *a = x + i, *b = y + i;
    const Lanes xm = load(a + kSsimRadius), ym = load(b + kSsimRadius);
    const Lanes xt = xm * kTaps[kSsimRadius], yt = ym * kTaps[kSsimRadius];
    Lanes sx = xt, sy = yt, sxx = xt * xm, syy = yt * ym, sxy = xt * ym;
    for (int k = 0; k < kSsimRadius; ++k) {
      const Lanes x0 = load(a + k), x1 = load(a + 2 * kSsimRadius - k);
      const Lanes y0 = load(b + k), y1 = load(b + 2 * kSsimRadius - k);
      sx = fma(x0 + x1, kTaps[k], sx);
      sy = fma(y0 + y1, kTaps[k], sy);
      sxx = fma(fma(x0, x0, x1 * x1), kTaps[k], sxx);
      syy = fma(fma(y0, y0, y1 * y1), kTaps[k], syy);
      sxy = fma(fma(x0, y0, x1 * y1), kTaps[k], sxy);
    }
    store(out + i, sx), store(out + pitch + i, sy), store(out + 2 * pitch + i, sxx);
    store(out + 3 * pitch + i, syy), store(out + 4 * pitch + i, sxy);
  }
}

float ssim_row(const float* const* rows, int width, int pitch, float* grad_mean, float* grad_xx, float* grad_xy) {
  Lanes sum_lanes = splat(0.0f);
  for (int i = 0; i < pitch; i += 16) {
    const Lanes mx = column(rows, i), my = column(rows, pitch + i);
    const Lanes xx = column(rows, 2 * pitch + i), yy = column(rows, 3 * pitch + i), xy = column(rows, 4 * pitch + i);
    const Lanes mxy = mx * my, squares = fma(mx, mx, my * my);
    const Lanes a1 = mxy * 2.0f + kC1, a2 = (xy - mxy) * 2.0f + kC2;
    const Lanes b1 = squares + kC1, b2 = (xx + yy) - squares + kC2;
    const Lanes inverse = splat(1.0f) / (b1 * b2);
    const Lanes d_a1 = a2 * inverse, d_a2 = a1 * inverse, value = a1 * d_a1;
    // Partial derivatives of a1·a2/(b1·b2); the moments xx and xy are raw, so means enter all four.
    const Lanes d_b1 = splat(0.0f) - value * (b2 * inverse), d_b2 = splat(0.0f) - value * (b1 * inverse);
    const Lanes d_mean = fma(my, d_a1 - d_a2, mx * (d_b1 - d_b2)) * 2.0f;
    // Beyond the image there is nothing to differentiate.
    const int count = width - i;
    store(grad_mean + i, first_lanes(count, d_mean));
    store(grad_xx + i, first_lanes(count, d_b2));
    store(grad_xy + i, first_lanes(count, d_a2 * 2.0f));
    sum_lanes = sum_lanes + first_lanes(count, value);
  }
  return sum(sum_lanes);
}

void maps_row(const float* padded, int pitch, float* out) {
  for (int i = 0; i < pitch; i += 16) {
    Lanes total = load(padded + i + kSsimRadius) * kTaps[kSsimRadius];
    for (int k = 0; k < kSsimRadius; ++k)
      total = fma(load(padded + i + k) + load(padded + i + 2 * kSsimRadius - k), kTaps[k], total);
    store(out + i, total);
  }
}

void photometric_row(const float* const* rows, const float* x, const float* y, int width, int pitch, float scale_ssim,
                     float scale_l1, float* grad, float* sums_out) {
  Lanes distance = splat(0.0f), square = splat(0.0f);
  for (int i = 0; i < pitch; i += 16) {
    const Lanes d_mean = column(rows, i), d_xx = column(rows, pitch + i), d_xy = column(rows, 2 * pitch + i);
    const Lanes a = load(x + i), b = load(y + i), difference = a - b;
    const Lanes sign = keep(difference > splat(0.0f), splat(scale_l1)) - keep(splat(0.0f) > difference, splat(scale_l1));
    store(grad + i, fma(fma(a * 2.0f, d_xx, fma(b, d_xy, d_mean)), scale_ssim, sign));
    const int count = width - i;
    distance = distance + first_lanes(count, max(difference, splat(0.0f) - difference));
    const Lanes shown = min(max(a, splat(0.0f)), splat(1.0f)) - b;
    square = square + first_lanes(count, shown * shown);
  }
  sums_out[0] = sum(distance), sums_out[1] = sum(square);
}

}  // namespace goc::GOC_ISA
