#include "photometric.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr int kPlanes = 3, kMoments = 5, kMaps = 3, kTapCount = 2 * kSsimRadius + 1;
constexpr int kStrip = 96;  // rows a task; each redoes 2·kSsimRadius rows of moments above and below its own

// One task's rows, small enough for a core's own cache: windows of kTapCount rows that move down the strip.
class Strip {
 public:
  Strip(const float* x, const std::uint8_t* target, int height, int width)
      : x_(x), target_(target), height_(height), width_(width), pitch_((width + 15) / 16 * 16) {
    thread_local std::vector<float> buffer;
    const std::size_t floats = (std::size_t)(pitch_ + 32) * 2 + (std::size_t)pitch_ * (kTapCount + 1) * (kMoments + kMaps) +
                               (std::size_t)(pitch_ + 32) * kMaps + 4 * pitch_;
    if (buffer.size() < floats) buffer.resize(floats);
    std::fill(buffer.begin(), buffer.end(), 0.0f);
    float* next = buffer.data();
    const auto take = [&](std::size_t count) { return std::exchange(next, next + count); };
    padded_x_ = take(pitch_ + 32), padded_y_ = take(pitch_ + 32), padded_map_ = take((std::size_t)(pitch_ + 32) * kMaps);
    moments_ = take((std::size_t)pitch_ * kTapCount * kMoments), maps_ = take((std::size_t)pitch_ * kTapCount * kMaps);
    zeros_ = take((std::size_t)pitch_ * (kMoments + kMaps)), grad_ = take(pitch_);
  }

  // Rows [begin, end): gradient and sums [Σ ssim, Σ |difference|, Σ squares].
  void run(int plane, int begin, int end, float scale_ssim, float scale_l1, float* grad, double* sums) {
    const Kernels& kernel = kernels();
    const float* rows[kTapCount];
    int moments_done = std::max(0, begin - 2 * kSsimRadius);
    for (int map = std::max(0, begin - kSsimRadius); map < std::min(height_, end + kSsimRadius); ++map) {
      for (; moments_done < std::min(height_, map + kSsimRadius + 1); ++moments_done) {
        read_rows(plane, moments_done);
        kernel.moments_row(padded_x_, padded_y_, pitch_, at(moments_, moments_done, kMoments));
      }
      window(moments_, kMoments, map, rows);
      float* maps[kMaps];
      for (int m = 0; m < kMaps; ++m) maps[m] = padded_map_ + (std::size_t)m * (pitch_ + 32) + kSsimRadius;
      const float ssim = kernel.ssim_row(rows, width_, pitch_, maps[0], maps[1], maps[2]);
      if (map >= begin && map < end) sums[0] += ssim;
      for (int m = 0; m < kMaps; ++m)
        kernel.maps_row(maps[m] - kSsimRadius, pitch_, at(maps_, map, kMaps) + (std::size_t)m * pitch_);
      if (map - kSsimRadius >= begin) finish(plane, map - kSsimRadius, scale_ssim, scale_l1, grad, sums);
    }
    // At the image's lower edge the last windows hang over it.
    for (int row = std::max(begin, std::min(height_, end + kSsimRadius) - kSsimRadius); row < end; ++row)
      finish(plane, row, scale_ssim, scale_l1, grad, sums);
  }

 private:
  float* at(float* ring, int row, int planes) { return ring + (std::size_t)(row % kTapCount) * planes * pitch_; }

  void read_rows(int plane, int row) {
    std::memcpy(padded_x_ + kSsimRadius, x_ + ((std::size_t)plane * height_ + row) * width_, width_ * sizeof(float));
    const std::uint8_t* from = target_ + (std::size_t)row * width_ * kPlanes + plane;
    for (int i = 0; i < width_; ++i) padded_y_[kSsimRadius + i] = from[i * kPlanes] * (1.0f / 255.0f);
  }

  // The rows round `row`, zeros outside the image.
  void window(float* ring, int planes, int row, const float** rows) {
    for (int k = 0; k < kTapCount; ++k) {
      const int there = row + k - kSsimRadius;
      rows[k] = there >= 0 && there < height_ ? at(ring, there, planes) : zeros_;
    }
  }

  void finish(int plane, int row, float scale_ssim, float scale_l1, float* grad, double* sums) {
    const float* rows[kTapCount];
    window(maps_, kMaps, row, rows);
    read_rows(plane, row);
    float found[2];
    kernels().photometric_row(rows, padded_x_ + kSsimRadius, padded_y_ + kSsimRadius, width_, pitch_, scale_ssim,
                              scale_l1, grad_, found);
    std::memcpy(grad + ((std::size_t)plane * height_ + row) * width_, grad_, width_ * sizeof(float));
    sums[1] += found[0], sums[2] += found[1];
  }

  const float* x_;
  const std::uint8_t* target_;
  int height_, width_, pitch_;
  float *padded_x_, *padded_y_, *padded_map_, *moments_, *maps_, *zeros_, *grad_;
};

}  // namespace

PhotometricLoss Photometric::operator()(const float* x, const std::uint8_t* target, int height, int width,
                                        float ssim_weight, float* grad) {
  const int strips = (height + kStrip - 1) / kStrip;
  const double size = (double)kPlanes * height * width;
  const float scale_ssim = -ssim_weight / (float)size, scale_l1 = (1.0f - ssim_weight) / (float)size;
  sums_.assign((std::size_t)strips * kPlanes * 3, 0.0);
  parallel_for((std::size_t)strips * kPlanes, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t task = begin; task < end; ++task) {
      const int plane = (int)(task / strips), first = (int)(task % strips) * kStrip;
      Strip(x, target, height, width)
          .run(plane, first, std::min(height, first + kStrip), scale_ssim, scale_l1, grad, sums_.data() + task * 3);
    }
  });
  double sum[3] = {};
  for (std::size_t k = 0; k < sums_.size(); ++k) sum[k % 3] += sums_[k];
  return {(1.0 - ssim_weight) * sum[1] / size + ssim_weight * (1.0 - sum[0] / size), sum[2] / size};
}

}  // namespace goc
