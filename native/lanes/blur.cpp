// Rows and columns of the SSIM window, and SSIM itself; plain loops that the compiler vectorises.
#include "kernels.hpp"

namespace goc::GOC_ISA {
namespace {

// exp(-(k − 5)² / (2·1.5²)), normalised.
const float kTaps[2 * kSsimRadius + 1] = {0.00102838f, 0.00759876f, 0.03600077f, 0.10936069f, 0.21300554f, 0.26601173f,
                                          0.21300554f, 0.10936069f, 0.03600077f, 0.00759876f, 0.00102838f};
constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;

}  // namespace

void blur_row(const float* __restrict padded, int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) {
    float total = 0.0f;
    for (int k = 0; k <= 2 * kSsimRadius; ++k) total += kTaps[k] * padded[i + k];
    out[i] = total;
  }
}

void blur_column(const float* const* rows, int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) out[i] = 0.0f;
  for (int k = 0; k <= 2 * kSsimRadius; ++k) {
    const float* __restrict row = rows[k];
    if (!row) continue;
    const float tap = kTaps[k];
    for (int i = 0; i < width; ++i) out[i] += tap * row[i];
  }
}

double ssim_row(const float* __restrict mean_x, const float* __restrict mean_y, const float* __restrict xx,
                const float* __restrict yy, const float* __restrict xy, int width, float* __restrict grad_mean,
                float* __restrict grad_xx, float* __restrict grad_xy) {
  double sum = 0.0;
  constexpr int kChunk = 256;
  float values[kChunk];
  for (int start = 0; start < width; start += kChunk) {
    const int count = width - start < kChunk ? width - start : kChunk;
    for (int j = 0; j < count; ++j) {
      const int i = start + j;
      const float mx = mean_x[i], my = mean_y[i];
      const float a1 = 2.0f * mx * my + kC1, a2 = 2.0f * (xy[i] - mx * my) + kC2;
      const float b1 = mx * mx + my * my + kC1, b2 = (xx[i] - mx * mx) + (yy[i] - my * my) + kC2;
      const float inverse = 1.0f / (b1 * b2), value = a1 * a2 * inverse;
      values[j] = value;
      // Partial derivatives of a1·a2/(b1·b2); the moments xx and xy are raw, so means enter all four.
      const float d_a1 = a2 * inverse, d_a2 = a1 * inverse, d_b1 = -value / b1, d_b2 = -value / b2;
      grad_mean[i] = 2.0f * (my * (d_a1 - d_a2) + mx * (d_b1 - d_b2));
      grad_xx[i] = d_b2;
      grad_xy[i] = 2.0f * d_a2;
    }
    for (int j = 0; j < count; ++j) sum += values[j];
  }
  return sum;
}

}  // namespace goc::GOC_ISA
