#include "block_ssim.hpp"

#include <algorithm>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr int kColours = 3, kMaps = 3, kMoments = 5;
constexpr int kPadding = 16;  // floats that kernels may read past a row
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

}  // namespace

PixelSum BlockSsim::operator()(const MaskedImages& images, float* x_grad) {
  const std::size_t size = (std::size_t)images.width * images.height;
  counted_.resize(size);
  maps_.resize(size * kColours * kMaps);
  sums_.assign(images.height, {});
  parallel_for(images.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) sums_[row] = block_row(images, (int)row);
  });
  parallel_for(images.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t row = begin; row < end; ++row) grad_row(images, (int)row, x_grad);
  });
  PixelSum total;
  for (const PixelSum& row : sums_) total += row;
  return total;
}

PixelSum BlockSsim::block_row(const MaskedImages& images, int row) {
  const int w = images.width, h = images.height;
  const std::size_t size = (std::size_t)w * h, at = (std::size_t)row * w;
  float* columns = row_buffer((std::size_t)w * kMoments + 2 * kPadding) + kPadding;
  float* counted = counted_.data() + at;
  PixelSum sum;
  std::fill_n(counted, w, 0.0f);
  if (row > 0 && row < h - 1) {  // with both neighbours
    add_rows(images.known + at, w, columns);
    for (int i = 1; i < w - 1; ++i) {
      counted[i] = columns[i - 1] + columns[i] + columns[i + 1] > 8.5f ? 1.0f : 0.0f;
      sum.pixels += counted[i] > 0;
    }
  }
  for (int map = 0; map < kColours * kMaps; ++map) {  // blocks round a row's first and last pixel are never whole
    float* values = maps_.data() + map * size + at;
    if (sum.pixels == 0) std::fill_n(values, w, 0.0f);
    values[0] = values[w - 1] = 0.0f;
  }
  if (sum.pixels == 0) return sum;
  for (int colour = 0; colour < kColours; ++colour) {
    const float *x = images.x + colour * size + at, *y = images.y + colour * size + at;
    float* map = maps_.data() + colour * kMaps * size + at;
    kernels().block_columns(x, y, w, columns);
    sum.value += kernels().block_row(columns, counted, x, y, w, map, map + size, map + 2 * size);
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
    columns[m] = row_buffer((std::size_t)(w + 2) * kMaps + kPadding) + m * (w + 2) + 1;
    columns[m][-1] = columns[m][w] = 0.0f;
  }
  for (int colour = 0; colour < kColours; ++colour) {
    const float* map = maps_.data() + colour * kMaps * size + at;
    for (int m = 0; m < kMaps; ++m, map += size)
      for (int i = 0; i < w; ++i)
        columns[m][i] = map[i] + (row > 0 ? map[i - w] : 0.0f) + (row < h - 1 ? map[i + w] : 0.0f);
    const float *x = images.x + colour * size + at, *y = images.y + colour * size + at;
    kernels().block_grad_row(columns, x, y, counted, w, x_grad + colour * size + at);
  }
}

}  // namespace goc
