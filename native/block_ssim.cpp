#include "block_ssim.hpp"

#include <cmath>

#include "threads.hpp"

namespace goc {
namespace {

constexpr float kShare = 0.85f;  // λ of Eq. (5)
constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;
constexpr int kColours = 3, kMaps = 3, kMoments = 5;
constexpr std::size_t kRowGrain = 8;

// A thread's own rows.
float* row_buffer(std::size_t floats) {
  thread_local std::vector<float> buffer;
  if (buffer.size() < floats) buffer.resize(floats);
  return buffer.data();
}

// out[i] = above[i] + at[i] + below[i] of the row at `at`.
void add_rows(const float* __restrict at, int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) out[i] = at[i - width] + at[i] + at[i + width];
}

// Sums over three rows of x, y, x², y², xy.
void moment_columns(const float* __restrict x, const float* __restrict y, int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) {
    const float a = x[i - width], b = x[i], c = x[i + width], d = y[i - width], e = y[i], f = y[i + width];
    out[i] = a + b + c;
    out[i + width] = d + e + f;
    out[i + 2 * width] = a * a + b * b + c * c;
    out[i + 3 * width] = d * d + e * e + f * f;
    out[i + 4 * width] = a * d + b * e + c * f;
  }
}

float mean_of_three(const float* column, int i) { return (column[i - 1] + column[i] + column[i + 1]) * (1.0f / 9.0f); }

// SSIM of the blocks of a row into `value`, and its derivatives by a block's moments into three maps; 0 where unknown.
void ssim_row(const float* columns, const float* __restrict counted, int width, float* __restrict value,
              float* __restrict by_mean, float* __restrict by_square, float* __restrict by_product) {
  for (int i = 1; i < width - 1; ++i) {
    const float mx = mean_of_three(columns, i), my = mean_of_three(columns + width, i);
    const float xx = mean_of_three(columns + 2 * width, i), yy = mean_of_three(columns + 3 * width, i);
    const float xy = mean_of_three(columns + 4 * width, i);
    const float a1 = 2 * mx * my + kC1, a2 = 2 * (xy - mx * my) + kC2;
    const float b1 = mx * mx + my * my + kC1, b2 = (xx - mx * mx) + (yy - my * my) + kC2;
    const float inverse = counted[i] / (b1 * b2), found = a1 * a2 * inverse;
    const float d_a1 = a2 * inverse, d_a2 = a1 * inverse, d_b1 = -found / b1, d_b2 = -found / b2;
    value[i] = found;
    by_mean[i] = 2 * (my * (d_a1 - d_a2) + mx * (d_b1 - d_b2));
    by_square[i] = d_b2;
    by_product[i] = 2 * d_a2;
  }
}

// Gradient of a row of x from the maps' columns: each pixel collects from the nine blocks that it is in.
void fold_row(const float* const* columns, const float* __restrict x, const float* __restrict y,
              const float* __restrict counted, int width, float* __restrict out) {
  for (int i = 0; i < width; ++i) {
    const float ssim = mean_of_three(columns[0], i) + 2 * x[i] * mean_of_three(columns[1], i) +
                       y[i] * mean_of_three(columns[2], i);
    const float difference = x[i] - y[i], sign = difference > 0 ? 1.0f : (difference < 0 ? -1.0f : 0.0f);
    out[i] = (counted[i] * (1 - kShare) * sign - kShare / 2 * ssim) / kColours;
  }
}

}  // namespace

PixelSum BlockSsim::operator()(const MaskedImages& images, float* x_grad) {
  const std::size_t size = (std::size_t)images.width * images.height;
  counted_.assign(size, 0.0f);
  maps_.assign(size * kColours * kMaps, 0.0f);
  sums_.assign(images.height, {});
  const int rows = images.height < 3 || images.width < 3 ? 0 : images.height - 2;  // those with both neighbours
  parallel_for(rows, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) sums_[row] = block_row(images, (int)row + 1);
  });
  parallel_for(images.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) grad_row(images, (int)row, x_grad);
  });
  PixelSum total;
  for (const PixelSum& row : sums_) total += row;
  return total;
}

PixelSum BlockSsim::block_row(const MaskedImages& images, int row) {
  const int w = images.width;
  const std::size_t size = (std::size_t)w * images.height, at = (std::size_t)row * w;
  float* columns = row_buffer((std::size_t)w * (kMoments + 1));
  float *values = columns + (std::size_t)w * kMoments, *counted = counted_.data() + at;
  PixelSum sum;
  add_rows(images.known + at, w, columns);
  for (int i = 1; i < w - 1; ++i) {
    counted[i] = columns[i - 1] + columns[i] + columns[i + 1] > 8.5f ? 1.0f : 0.0f;
    sum.pixels += counted[i] > 0;
  }
  if (sum.pixels == 0) return sum;
  for (int colour = 0; colour < kColours; ++colour) {
    const float *x = images.x + colour * size + at, *y = images.y + colour * size + at;
    float* map = maps_.data() + colour * kMaps * size + at;
    moment_columns(x, y, w, columns);
    ssim_row(columns, counted, w, values, map, map + size, map + 2 * size);
    for (int i = 1; i < w - 1; ++i)
      sum.value += counted[i] * (kShare / 2) - values[i] * (kShare / 2) + counted[i] * (1 - kShare) * std::fabs(x[i] - y[i]);
  }
  sum.value /= kColours;
  return sum;
}

void BlockSsim::grad_row(const MaskedImages& images, int row, float* x_grad) const {
  const int w = images.width, h = images.height;
  const std::size_t size = (std::size_t)w * h, at = (std::size_t)row * w;
  const float* counted = counted_.data() + at;
  float* columns[kMaps];  // one more pixel of zero on either side
  for (int m = 0; m < kMaps; ++m) {
    columns[m] = row_buffer((std::size_t)(w + 2) * kMaps) + m * (w + 2) + 1;
    columns[m][-1] = columns[m][w] = 0.0f;
  }
  for (int colour = 0; colour < kColours; ++colour) {
    const float* map = maps_.data() + colour * kMaps * size + at;
    for (int m = 0; m < kMaps; ++m, map += size)
      for (int i = 0; i < w; ++i)
        columns[m][i] = map[i] + (row > 0 ? map[i - w] : 0.0f) + (row < h - 1 ? map[i + w] : 0.0f);
    fold_row(columns, images.x + colour * size + at, images.y + colour * size + at, counted, w, x_grad + colour * size + at);
  }
}

}  // namespace goc
