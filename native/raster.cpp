// Orchestrates a view: project → sort by depth → bin to tiles → blend; backward in reverse.
#include "raster.hpp"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>

#include "splat_lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kSplatGrain = 1024;
constexpr std::size_t kAhead = 8;  // iterations between asking for a cache line and using it

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
  ranges_.resize(size_);
  const std::size_t chunks = (size_ + kSplatGrain - 1) / kSplatGrain;
  touches_.resize(chunks);
  parallel_for(size_, kSplatGrain, [&](std::size_t begin, std::size_t end) {
    auto& touches = touches_[begin / kSplatGrain];
    touches.clear();
    SplatLanes lanes;
    ProjectedLanes projected;
    alignas(64) float harmonics[16][16];
    for (std::size_t first = begin; first < end; first += 16) {
      const int count = (int)std::min<std::size_t>(16, end - first);
      read_lanes(splats, first, count, lanes);
      const std::uint32_t candidates = kernels().project_lanes(lanes, camera_, channels.planes, projected);
      std::uint32_t visible = 0;
      for (int l = 0; l < count; ++l) {
        const auto before = (std::uint32_t)touches.size();
        if (candidates >> l & 1) {
          float* row = rows_ + (first + l) * row_stride_;
          for (int k = 0; k < kPacked; ++k) row[k] = projected.splat[k][l];
          touch(*reinterpret_cast<const Splat2D*>(row), projected.reach[0][l], projected.reach[1][l], touches);
        }
        ranges_[first + l] = {before, (std::uint32_t)touches.size() - before};
        visible |= (std::uint32_t)(touches.size() != before) << l;
      }
      if (visible && channels.sh) kernels().harmonics_lanes(lanes, channels.eye, channels.harmonics, harmonics);
      for (; visible; visible &= visible - 1) {
        const int l = __builtin_ctz(visible);
        float* row = rows_ + (first + l) * row_stride_ + kPacked;
        fill_channels(channels, first + l, l, projected, harmonics, row);
        for (int c = channel_count_; c < row_stride_ - kPacked; ++c) row[c] = 0.0f;
      }
    }
  });
  chunk_begin_.resize(chunks + 1);
  chunk_begin_[0] = 0;
  for (std::size_t k = 0; k < chunks; ++k) chunk_begin_[k + 1] = chunk_begin_[k] + (std::uint32_t)touches_[k].size();
}

// Appends the tiles that the splat reaches.
void Raster::touch(const Splat2D& s, float reach_x, float reach_y, std::vector<Touch>& touches) const {
  // Tiles whose pixel centres can lie within reach.
  const auto tiles = [](float from, float to, int count, int& first, int& last) {
    const float inverse = 1.0f / kTile;
    // Truncation after the clamp is floor(), which baseline x86-64 has only as a call.
    first = (int)std::clamp((from - 0.5f) * inverse, 0.0f, (float)count);
    last = (int)std::clamp((to - 0.5f) * inverse + 1.0f, 0.0f, (float)count);
  };
  int x0, x1, y0, y1;
  tiles(s.x - reach_x, s.x + reach_x, tiles_x_, x0, x1);
  tiles(s.y - reach_y, s.y + reach_y, tiles_y_, y0, y1);
  const auto touched_blocks = kernels().touched_blocks;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x)
      if (const std::uint16_t mask = touched_blocks(s, (float)(x * kTile), (float)(y * kTile)))
        touches.push_back({(std::uint16_t)x, (std::uint16_t)y, mask});
}

// Stable radix sort of the visible splats by the bits of their (positive) depth.
void Raster::sort_by_depth() {
  keys_.clear();
  for (std::size_t i = 0; i < size_; ++i) {
    if (!ranges_[i].count) continue;
    std::uint32_t bits;
    std::memcpy(&bits, rows_ + i * row_stride_ + offsetof(Splat2D, depth) / sizeof(float), sizeof bits);
    keys_.push_back((std::uint64_t)bits << 32 | i);
  }
  keys_scratch_.resize(keys_.size());
  for (int shift = 32; shift < 64; shift += 11) {
    std::uint32_t start[2049] = {};
    for (const auto key : keys_) ++start[(key >> shift & 2047) + 1];
    for (int b = 0; b < 2048; ++b) start[b + 1] += start[b];
    for (const auto key : keys_) keys_scratch_[start[key >> shift & 2047]++] = key;
    keys_.swap(keys_scratch_);
  }
  by_depth_.resize(keys_.size());
  for (std::size_t k = 0; k < keys_.size(); ++k) by_depth_[k] = (std::uint32_t)keys_[k];
}

void Raster::bin() {
  const std::size_t visible = by_depth_.size(), tiles = (std::size_t)tiles_x_ * tiles_y_;
  // Each chunk of splats counts its records a tile; a prefix sum over (tile, chunk) then gives every chunk its own
  // places in each tile's list, in depth order, whatever the number of threads.
  const std::size_t grain = std::max(kSplatGrain, (visible + 7) / 8);
  const std::size_t chunks = (visible + grain - 1) / grain;
  histogram_.assign(chunks * tiles, 0);
  const auto each = [&](std::size_t begin, std::size_t end, auto&& body) {
    for (std::size_t k = begin; k < end; ++k) {
      if (k + 2 * kAhead < end) __builtin_prefetch(&ranges_[by_depth_[k + 2 * kAhead]]);
      if (k + kAhead < end) {
        const std::uint32_t next = by_depth_[k + kAhead];
        __builtin_prefetch(&touches_[next / kSplatGrain][ranges_[next].begin]);
      }
      const std::uint32_t i = by_depth_[k];
      const Range range = ranges_[i];
      const Touch* touch = touches_[i / kSplatGrain].data() + range.begin;
      const std::uint32_t slot = chunk_begin_[i / kSplatGrain] + range.begin;
      for (std::uint32_t j = 0; j < range.count; ++j)
        body((std::size_t)touch[j].y * tiles_x_ + touch[j].x, i, touch[j].mask, slot + j);
    }
  };
  parallel_for(visible, grain, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* count = histogram_.data() + begin / grain * tiles;
    each(begin, end, [&](std::size_t tile, std::uint32_t, std::uint16_t, std::uint32_t) { ++count[tile]; });
  });
  tile_begin_.resize(tiles + 1);
  std::uint32_t total = 0;
  for (std::size_t t = 0; t < tiles; ++t) {
    tile_begin_[t] = total;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
      const std::uint32_t count = histogram_[chunk * tiles + t];
      histogram_[chunk * tiles + t] = total;
      total += count;
    }
  }
  tile_begin_[tiles] = total;
  order_.resize(total), masks_.resize(total), slots_.resize(total);
  parallel_for(visible, grain, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* next = histogram_.data() + begin / grain * tiles;
    each(begin, end, [&](std::size_t tile, std::uint32_t splat, std::uint16_t mask, std::uint32_t slot) {
      const std::uint32_t record = next[tile]++;
      order_[record] = splat, masks_[record] = mask, slots_[record] = slot;
    });
  });
}

TileView Raster::tile(std::size_t index, int pass) const {
  const std::uint32_t begin = tile_begin_[index];
  TileView view;
  view.rows = rows_;
  view.row_stride = row_stride_;
  view.order = order_.data() + begin;
  view.masks = masks_.data() + begin;
  view.slots = slots_.data() + begin;
  view.count = (int)(tile_begin_[index + 1] - begin);
  view.x0 = (int)(index % tiles_x_) * kTile;
  view.y0 = (int)(index / tiles_x_) * kTile;
  view.width = camera_.width;
  view.height = camera_.height;
  view.channel_offset = pass * kMaxChannels;
  view.channel_count = channels_of(pass);
  return view;
}

void Raster::forward(const SplatArrays& splats, const Channels& channels, const RasterCamera& camera,
                     float* const* image, float* alpha) {
  camera_ = camera;
  channel_count_ = channels.count();
  tiles_x_ = (camera.width + kTile - 1) / kTile;
  tiles_y_ = (camera.height + kTile - 1) / kTile;
  // Whole cache lines: with up to eight channels a splat is one.
  row_stride_ = (kPacked + (passes() - 1) * kMaxChannels + padded_channels(channels_of(passes() - 1)) + 15) / 16 * 16;
  rows_ = rows_lines_.resized(splats.size * row_stride_);
  project_all(splats, channels);
  sort_by_depth();
  bin();
  parallel_for((std::size_t)tiles_x_ * tiles_y_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t)
      for (int pass = 0; pass < passes(); ++pass) {
        const TileView view = tile(t, pass);
        kernels().forward_tile(view, image + view.channel_offset, alpha, scratch((std::size_t)view.count * 16));
      }
  });
}

void Raster::backward(const SplatArrays& splats, const Channels& channels, const float* const* image,
                      const float* alpha, const float* const* image_grad, const float* alpha_grad,
                      const SplatGradients* out, const ChannelGradients& channels_out) {
  const int whole = gradient_floats(kMaxChannels), last = gradient_floats(channels_of(passes() - 1));
  const int stride = (passes() - 1) * whole + last;
  float* grads = grads_lines_.resized(order_.size() * stride);
  parallel_for((std::size_t)tiles_x_ * tiles_y_, 1, [&](std::size_t begin, std::size_t end) {
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
  for (int l = 0; l < count; ++l) visible |= (std::uint32_t)(ranges_[first + l].count != 0) << l;
  if (visible) read_lanes(splats, first, count, lanes);
  if (visible && channels.sh) kernels().harmonics_lanes(lanes, channels.eye, channels.harmonics, harmonics);
  for (int l = 0; l < count; ++l) {
    const std::size_t i = first + l;
    if (!ranges_[i].count) {
      clear_channels(channels, i, channels_out);
      continue;
    }
    // A splat's records lie together, one cache line each with up to ten channels.
    const float* from = grads + (std::size_t)(chunk_begin_[i / kSplatGrain] + ranges_[i].begin) * stride;
    for (int k = 0; k < stride; ++k) sum[k] = from[k];
    for (std::uint32_t j = 1; j < ranges_[i].count; ++j) {
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
  parallel_for((std::size_t)tiles_x_ * tiles_y_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const TileView view = tile(t, 0);
      kernels().median_tile(view, found.data(), scratch((std::size_t)view.count * 16));
    }
  });
  for (std::size_t i = 0; i < found.size(); ++i) out[i] = (std::int32_t)found[i];
}

std::size_t Raster::blocks() const {
  std::size_t total = 0;
  for (const auto mask : masks_) total += (std::size_t)std::popcount(mask);
  return total;
}

std::size_t Raster::bytes() const {
  const auto of = [](const auto& buffer) { return buffer.capacity() * sizeof(buffer[0]); };
  std::size_t total = rows_lines_.bytes() + grads_lines_.bytes() + of(touches_) + of(chunk_begin_) + of(ranges_) +
                      of(by_depth_) + of(keys_) + of(keys_scratch_) + of(tile_begin_) + of(histogram_) + of(order_) +
                      of(slots_) + of(masks_);
  for (const auto& touches : touches_) total += of(touches);
  return total;
}

void Raster::visible(std::uint8_t* out) const {
  for (std::size_t i = 0; i < size_; ++i) out[i] = ranges_[i].count != 0;
}

}  // namespace goc
