#include "geometry_loss.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kRowGrain = 16;
constexpr int kBorder = 16;  // floats to the left of a row, and to the right of its last whole Lanes
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Rows of a thread's own, each whole Lanes long.
class Rows {
 public:
  Rows(int count, int width) : pitch_((width + 15) / 16 * 16), width_(width) {
    thread_local std::vector<float> buffer;
    if (buffer.size() < (std::size_t)count * pitch_) buffer.resize((std::size_t)count * pitch_);
    data_ = buffer.data();
  }
  float* operator[](int k) { return data_ + (std::size_t)k * pitch_; }
  // Row y of an image, followed by `after` instead of by the next row.
  float* copy(int k, const float* image, int y, float after) {
    float* to = (*this)[k];
    std::memcpy(to, image + (std::size_t)y * width_, width_ * sizeof(float));
    std::fill(to + width_, to + pitch_, after);
    return to;
  }

 private:
  int pitch_, width_;
  float* data_;
};

// One row of the normals as three rows of numbers, NaN where there is none.
void read_normals(const DepthImages& images, int y, int width, float* const* out) {
  if (images.prior_normals) {
    const float* from = images.prior_normals + (std::size_t)y * width * 3;
    for (int i = 0; i < width; ++i)
      for (int k = 0; k < 3; ++k) out[k][i] = from[3 * i + k];
    return;
  }
  const std::int8_t* from = images.packed_normals + (std::size_t)y * width * 3;
  for (int i = 0; i < width; ++i) {
    const float a = from[3 * i], b = from[3 * i + 1], c = from[3 * i + 2], squared = a * a + b * b + c * c;
    const float inverse = squared > 0 ? 1.0f / std::sqrt(squared) : kNaN;
    out[0][i] = a * inverse, out[1][i] = b * inverse, out[2][i] = c * inverse;
  }
}

}  // namespace

float* GeometryLoss::row(std::vector<float>& image, int y) {
  return image.data() + (std::size_t)(y + 1) * pitch_ + kBorder;
}

GeometryLosses GeometryLoss::operator()(const DepthImages& images, const Lens& lens, float depth_weight,
                                        float normal_weight, float* numerator_grad, float* denominator_grad) {
  const int w = lens.width, h = lens.height;
  const Kernels& kernel = kernels();
  const bool with_normals = (images.prior_normals || images.packed_normals) && normal_weight != 0.0f;
  pitch_ = (w + 15) / 16 * 16 + 2 * kBorder;
  const std::size_t size = (std::size_t)(h + 2) * pitch_;
  depth_.assign(size, kNaN);
  sums_.assign((std::size_t)h * 4, 0.0);  // a row: Σ|D − D̂|, count, Σ α(1 − cos), count
  parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
    Rows rows(4, w);
    for (int y = (int)begin; y < (int)end; ++y) {
      float sums[2];
      kernel.depth_row(rows.copy(0, images.numerator, y, 0), rows.copy(1, images.denominator, y, 0),
                       rows.copy(2, images.alpha, y, 0), rows.copy(3, images.prior_depth, y, kNaN), w, row(depth_, y),
                       sums);
      sums_[(std::size_t)y * 4] = sums[0], sums_[(std::size_t)y * 4 + 1] = sums[1];
    }
  });
  if (with_normals) {
    for (auto* image : {&to_right_, &to_left_, &to_below_, &to_above_})
      if (image->size() != size) image->assign(size, 0.0f);
    parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
      Rows rows(4, w);
      for (int y = (int)begin; y < (int)end; ++y) {
        float* normal[3] = {rows.copy(0, images.alpha, y, kNaN), rows.copy(1, images.alpha, y, kNaN),
                            rows.copy(2, images.alpha, y, kNaN)};
        read_normals(images, y, w, normal);
        const NormalRow input{row(depth_, y - 1), row(depth_, y),   row(depth_, y + 1),
                              {normal[0], normal[1], normal[2]},    rows.copy(3, images.alpha, y, 0),
                              (0.5f - lens.cx) / lens.fx,           1.0f / lens.fx,
                              (y + 0.5f - lens.cy) / lens.fy,       1.0f / lens.fy};
        float* const out[4] = {row(to_right_, y), row(to_left_, y), row(to_below_, y), row(to_above_, y)};
        float sums[2];
        kernel.normal_row(input, w, out, sums);
        sums_[(std::size_t)y * 4 + 2] = sums[0], sums_[(std::size_t)y * 4 + 3] = sums[1];
      }
    });
  }
  double sum[4] = {};
  for (int y = 0; y < h; ++y)
    for (int k = 0; k < 4; ++k) sum[k] += sums_[(std::size_t)y * 4 + k];
  const float depth_scale = depth_weight / (float)std::max(sum[1], 1.0);
  const float normal_scale = normal_weight / (float)std::max(sum[3], 1.0);
  parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
    Rows rows(4, w);
    for (int y = (int)begin; y < (int)end; ++y) {
      DepthGradRow input{row(depth_, y), rows.copy(0, images.prior_depth, y, kNaN),
                         rows.copy(1, images.denominator, y, 1), nullptr, nullptr, nullptr, nullptr, depth_scale,
                         normal_scale};
      if (with_normals) {
        input.from_left = row(to_right_, y), input.from_right = row(to_left_, y);
        input.from_above = row(to_below_, y - 1), input.from_below = row(to_above_, y + 1);
      }
      kernel.depth_grad_row(input, w, rows[2], rows[3]);
      std::memcpy(numerator_grad + (std::size_t)y * w, rows[2], w * sizeof(float));
      std::memcpy(denominator_grad + (std::size_t)y * w, rows[3], w * sizeof(float));
    }
  });
  return {sum[0] / std::max(sum[1], 1.0), sum[2] / std::max(sum[3], 1.0)};
}

void plane_fraction(const float* planes, const Lens& lens, float* numerator, float* denominator) {
  const std::size_t w = lens.width, size = w * lens.height;
  parallel_for(lens.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y) {
      const float* const rows[4] = {planes + y * w, planes + size + y * w, planes + 2 * size + y * w,
                                    planes + 3 * size + y * w};
      kernels().fraction_row(rows, (0.5f - lens.cx) / lens.fx, 1.0f / lens.fx, (y + 0.5f - lens.cy) / lens.fy, (int)w,
                             numerator + y * w, denominator + y * w);
    }
  });
}

void plane_fraction_backward(const float* numerator_grad, const float* denominator_grad, const Lens& lens,
                             float* planes_grad) {
  const std::size_t w = lens.width, size = w * lens.height;
  parallel_for(lens.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y) {
      float* const rows[4] = {planes_grad + y * w, planes_grad + size + y * w, planes_grad + 2 * size + y * w,
                              planes_grad + 3 * size + y * w};
      kernels().fraction_grad_row(numerator_grad + y * w, denominator_grad + y * w, (0.5f - lens.cx) / lens.fx,
                                  1.0f / lens.fx, (y + 0.5f - lens.cy) / lens.fy, (int)w, rows);
    }
  });
}

}  // namespace goc
