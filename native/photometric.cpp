#include "photometric.hpp"

#include <cmath>
#include <cstring>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr int kMoments = 5;  // x, y, xx, yy, xy
constexpr int kGradients = 3;
constexpr std::size_t kRowGrain = 16;

// A thread's own rows.
float* row_buffer(std::size_t floats) {
  thread_local std::vector<float> buffer;
  if (buffer.size() < floats) buffer.resize(floats);
  return buffer.data();
}

// The 11 rows round `y` of the image at `base`, null outside it.
void window(const float* base, int y, int height, int width, const float** rows) {
  for (int k = 0; k <= 2 * kSsimRadius; ++k) {
    const int at = y + k - kSsimRadius;
    rows[k] = at >= 0 && at < height ? base + (std::size_t)at * width : nullptr;
  }
}

}  // namespace

double Photometric::operator()(const float* x, const float* y, int planes, int height, int width, float ssim_weight,
                               float* grad) {
  const std::size_t rows = (std::size_t)planes * height, plane = (std::size_t)height * width, size = plane * planes;
  const Kernels& kernel = kernels();
  rows_.resize(size * kMoments);
  maps_.resize(size * kGradients);
  sums_.assign(rows * 2, 0.0);
  const auto moment = [&](int m) { return rows_.data() + m * size; };
  const auto map = [&](int m) { return maps_.data() + m * size; };
  // Each moment's rows.
  parallel_for(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    float* padded = row_buffer(width + 2 * kSsimRadius);
    std::memset(padded, 0, (width + 2 * kSsimRadius) * sizeof(float));
    float* middle = padded + kSsimRadius;
    for (std::size_t r = begin; r < end; ++r) {
      const float *a = x + r * width, *b = y + r * width;
      for (int m = 0; m < kMoments; ++m) {
        const float *left = m == 1 ? b : (m == 3 ? b : a), *right = m == 2 ? a : b;
        if (m < 2) std::memcpy(middle, left, width * sizeof(float));
        else
          for (int i = 0; i < width; ++i) middle[i] = left[i] * right[i];
        kernel.blur_row(padded, width, moment(m) + r * width);
      }
    }
  });
  // Each moment's columns, SSIM and its gradient maps.
  parallel_for(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    float* blurred = row_buffer((std::size_t)width * kMoments);
    const float* taps[2 * kSsimRadius + 1];
    for (std::size_t r = begin; r < end; ++r) {
      const std::size_t p = r / height;
      const int row = (int)(r % height);
      for (int m = 0; m < kMoments; ++m) {
        window(moment(m) + p * plane, row, height, width, taps);
        kernel.blur_column(taps, width, blurred + (std::size_t)m * width);
      }
      const float* b = blurred;
      sums_[r] = kernel.ssim_row(b, b + width, b + 2 * width, b + 3 * width, b + 4 * width, width,
                                 map(0) + r * width, map(1) + r * width, map(2) + r * width);
    }
  });
  // The window is symmetric, so its transpose is itself: blur the gradient maps, rows first.
  parallel_for(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    float* padded = row_buffer(width + 2 * kSsimRadius);
    std::memset(padded, 0, (width + 2 * kSsimRadius) * sizeof(float));
    for (std::size_t r = begin; r < end; ++r)
      for (int m = 0; m < kGradients; ++m) {
        std::memcpy(padded + kSsimRadius, map(m) + r * width, width * sizeof(float));
        kernel.blur_row(padded, width, moment(m) + r * width);
      }
  });
  const float scale_ssim = -ssim_weight / (float)size, scale_l1 = (1.0f - ssim_weight) / (float)size;
  parallel_for(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    float* blurred = row_buffer((std::size_t)width * kGradients);
    const float* taps[2 * kSsimRadius + 1];
    for (std::size_t r = begin; r < end; ++r) {
      const std::size_t p = r / height;
      for (int m = 0; m < kGradients; ++m) {
        window(moment(m) + p * plane, (int)(r % height), height, width, taps);
        kernel.blur_column(taps, width, blurred + (std::size_t)m * width);
      }
      const float *a = x + r * width, *b = y + r * width;
      const float *d_mean = blurred, *d_xx = d_mean + width, *d_xy = d_xx + width;
      float* out = grad + r * width;
      double distance = 0.0;
      for (int i = 0; i < width; ++i) {
        const float difference = a[i] - b[i];
        const float sign = difference > 0 ? 1.0f : (difference < 0 ? -1.0f : 0.0f);
        out[i] = scale_ssim * (d_mean[i] + 2.0f * a[i] * d_xx[i] + b[i] * d_xy[i]) + scale_l1 * sign;
        distance += std::fabs(difference);
      }
      sums_[rows + r] = distance;
    }
  });
  double ssim = 0.0, distance = 0.0;
  for (std::size_t r = 0; r < rows; ++r) ssim += sums_[r], distance += sums_[rows + r];
  return (1.0 - ssim_weight) * distance / (double)size + ssim_weight * (1.0 - ssim / (double)size);
}

}  // namespace goc
