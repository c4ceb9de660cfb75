// Orchestrates a view: project → bin to tiles → sort each by depth → blend; backward in reverse.
#include "raster.hpp"

#include <algorithm>

#include "splat_lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kSplatGrain = 1024, kTileGrain = 8;

// A thread's own workspace; grows to the largest tile and stays.
std::uint32_t* scratch(std::size_t count) {
  thread_local std::vector<std::uint32_t> buffer;
  if (buffer.size() < count) buffer.resize(count + count / 2);
  return buffer.data();
}

}  // namespace

float* Lines::resized(std::size_t floats) {
  constexpr std::size_t kLine = 16;
  if (floats_.size() < floats + kLine) floats_ = std::vector<float>(floats + floats / 8 + kLine);
  const auto address = reinterpret_cast<std::uintptr_t>(floats_.data());
  return floats_.data() + (64 - address % 64) % 64 / sizeof(float);
}

int Raster::channels_of(int pass) const { return std::min(channel_count_ - pass * kMaxChannels, kMaxChannels); }

// Rows and touched tiles of all splats, in the order in which they are stored: neighbours there tend to be neighbours
// in space.
void Raster::project_all(const SplatArrays& splats, const Channels& channels) {
  size_ = splats.size;
  bins_.begin(size_, camera_.width, camera_.height);
  parallel_for(size_, bins_.grain(), [&](std::size_t begin, std::size_t end) {
    Bins::Chunk& chunk = bins_.chunk_of(begin);
    SplatLanes lanes;
    ProjectedLanes projected;
    Footprints footprints;
    alignas(64) float harmonics[16][16];
    for (std::size_t first = begin; first < end; first += 16) {
      const int count = (int)std::min<std::size_t>(16, end - first);
      read_lanes(splats, first, count, lanes);
      const std::uint32_t candidates = kernels().project_lanes(lanes, camera_, channels.planes, projected, footprints);
      std::uint32_t visible = 0;
      for (int l = 0; l < count; ++l) {
        if (!(candidates >> l & 1)) {
          chunk.skip(bins_, first + l);
          continue;
        }
        float* row = rows_ + (first + l) * row_stride_;
        for (int k = 0; k < kPacked; ++k) row[k] = projected.splat[k][l];
        const auto& splat = *reinterpret_cast<const Splat2D*>(row);
        visible |= (std::uint32_t)chunk.add(bins_, first + l, splat, footprints, l) << l;
      }
      if (visible && channels.sh) kernels().harmonics_lanes(lanes, channels.eye, channels.harmonics, harmonics);
      for (; visible; visible &= visible - 1) {
        const int l = __builtin_ctz(visible);
        float* row = rows_ + (first + l) * row_stride_ + kPacked;
        fill_channels(channels, first + l, l, projected, harmonics, row);
        for (int c = channel_count_; c < row_stride_ - kPacked; ++c) row[c] = 0.0f;
      }
    }
    chunk.close();
  });
}

TileView Raster::tile(std::size_t index, int pass) const {
  TileView view;
  bins_.view(index, view);
  view.rows = rows_;
  view.row_stride = row_stride_;
  view.width = camera_.width;
  view.height = camera_.height;
  view.channel_offset = pass * kMaxChannels;
  view.channel_count = channels_of(pass);
  return view;
}

void Raster::forward(const SplatArrays& splats, const Channels& channels, const DrawCamera& camera,
                     float* const* image, float* alpha) {
  camera_ = camera;
  channel_count_ = channels.count();
  // Whole cache lines: with up to eight channels a splat is one.
  row_stride_ = (kPacked + (passes() - 1) * kMaxChannels + padded_channels(channels_of(passes() - 1)) + 15) / 16 * 16;
  rows_ = rows_lines_.resized(splats.size * row_stride_);
  project_all(splats, channels);
  bins_.scatter();
  parallel_for(bins_.tiles(), kTileGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      bins_.sort_tile(t);
      for (int pass = 0; pass < passes(); ++pass) {
        const TileView view = tile(t, pass);
        kernels().forward_tile(view, image + view.channel_offset, alpha, scratch((std::size_t)view.count * 16));
      }
    }
  });
}

void Raster::backward(const SplatArrays& splats, const Channels& channels, const float* const* image,
                      const float* alpha, const float* const* image_grad, const float* alpha_grad,
                      const SplatGradients* out, const ChannelGradients& channels_out) {
  const int whole = gradient_floats(kMaxChannels), last = gradient_floats(channels_of(passes() - 1));
  const int stride = (passes() - 1) * whole + last;
  float* grads = grads_lines_.resized(bins_.records() * stride);
  parallel_for(bins_.tiles(), kTileGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t)
      for (int pass = 0; pass < passes(); ++pass) {
        const TileView view = tile(t, pass);
        kernels().backward_tile(view, image + view.channel_offset, alpha, image_grad + view.channel_offset,
                                pass == 0 ? alpha_grad : nullptr, out == nullptr, grads + pass * whole, stride);
      }
  });
  parallel_for(size_, kSplatGrain, [&](std::size_t begin, std::size_t end) {
    thread_local std::vector<float> sum;
    sum.resize(stride + channel_count_);
    for (std::size_t first = begin; first < end; first += 16)
      splats_backward(splats, channels, first, (int)std::min<std::size_t>(16, end - first), grads, stride, sum, out,
                      channels_out);
  });
}

// Of more than one pass: adds up the geometry of each, and brings their channels together.
const float* Raster::gather_passes(std::vector<float>& sum, int lane, ProjectedLanes& grad) const {
  const int whole = gradient_floats(kMaxChannels);
  float* channel = sum.data() + sum.size() - channel_count_;
  for (int pass = 0; pass < passes(); ++pass) {
    for (int k = 0; k < kGeometry && pass > 0; ++k) grad.splat[k][lane] += sum[pass * whole + k];
    std::copy_n(sum.data() + pass * whole + kGeometry, channels_of(pass), channel + pass * kMaxChannels);
  }
  return channel;
}

// The gradients of up to sixteen splats from those of their records.
void Raster::splats_backward(const SplatArrays& splats, const Channels& channels, std::size_t first, int count,
                             const float* grads, int stride, std::vector<float>& sum, const SplatGradients* out,
                             const ChannelGradients& channels_out) {
  SplatLanes lanes;
  ProjectedLanes grad{};
  alignas(64) float harmonics[16][16];
  std::uint32_t visible = 0;
  for (int l = 0; l < count; ++l) visible |= (std::uint32_t)(bins_.touched(first + l) != 0) << l;
  if (visible) read_lanes(splats, first, count, lanes);
  if (visible && channels.sh) kernels().harmonics_lanes(lanes, channels.eye, channels.harmonics, harmonics);
  for (int l = 0; l < count; ++l) {
    const std::size_t i = first + l;
    const std::uint32_t records = bins_.touched(i);
    if (!records) {
      clear_channels(channels, i, channels_out);
      continue;
    }
    // A splat's records lie together, one cache line each with up to ten channels.
    const float* from = grads + bins_.first_slot(i) * stride;
    for (int k = 0; k < stride; ++k) sum[k] = from[k];
    for (std::uint32_t j = 1; j < records; ++j) {
      from += stride;
      for (int k = 0; k < stride; ++k) sum[k] += from[k];
    }
    for (int k = 0; k < kGeometry; ++k) grad.splat[k][l] = sum[k];
    const float* channel = sum.data() + kGeometry;
    if (passes() > 1) channel = gather_passes(sum, l, grad);
    channels_backward(channels, i, l, rows_ + i * row_stride_ + kPacked, channel, harmonics, channels_out, grad);
  }
  if (!out) return;
  SplatLanes splat_grads;
  const bool depths = channels.sh && !channels.planes;
  if (visible) kernels().project_lanes_backward(lanes, camera_, grad, channels.planes, depths, splat_grads);
  write_lanes(splat_grads, first, count, visible, *out);
}

void Raster::median(std::int32_t* out) const {
  std::vector<float> found((std::size_t)camera_.width * camera_.height);
  parallel_for(bins_.tiles(), kTileGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const TileView view = tile(t, 0);
      kernels().median_tile(view, found.data(), scratch((std::size_t)view.count * 16));
    }
  });
  for (std::size_t i = 0; i < found.size(); ++i) out[i] = (std::int32_t)found[i];
}

}  // namespace goc
