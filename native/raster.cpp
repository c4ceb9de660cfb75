// Orchestrates a view: project → sort by depth → bin to tiles → blend; backward in reverse.
#include "raster.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "threads.hpp"

namespace goc {
namespace {

constexpr std::uint32_t kNoRecord = 0xffffffffu;
constexpr std::size_t kSplatGrain = 1024;
constexpr int kGeometry = 6;

int padded(int channels) {
  if (channels <= 8) return channels;
  if (channels <= 12) return 12;
  if (channels <= 16) return 16;
  return channels <= 24 ? 24 : kMaxChannels;
}

// A thread's own workspace; grows to the largest tile and stays.
float* scratch(std::size_t floats) {
  thread_local std::vector<float> buffer;
  if (buffer.size() < floats) buffer.resize(floats + floats / 2);
  return buffer.data();
}

}  // namespace

void Raster::project_all(const SplatArrays& splats) {
  splats_.resize(splats.size);
  boxes_.resize(splats.size);
  parallel_for(splats.size, kSplatGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      boxes_[i] = {0, 0, 0, 0};
      float reach[2];
      Splat2D& s = splats_[i];
      if (!project(splats, i, camera_, s, reach)) continue;
      // Tiles whose pixel centres can lie within reach.
      const auto tiles = [](float from, float to, int count, std::int16_t& first, std::int16_t& last) {
        const float inverse = 1.0f / kTile;
        first = (std::int16_t)std::clamp(std::floor((from - 0.5f) * inverse), 0.0f, (float)count);
        last = (std::int16_t)std::clamp(std::floor((to - 0.5f) * inverse) + 1.0f, 0.0f, (float)count);
      };
      Box box;
      tiles(s.x - reach[0], s.x + reach[0], tiles_x_, box.x0, box.x1);
      tiles(s.y - reach[1], s.y + reach[1], tiles_y_, box.y0, box.y1);
      if (box.x0 < box.x1 && box.y0 < box.y1) boxes_[i] = box;
    }
  });
}

// Stable radix sort of the visible splats by the bits of their (positive) depth.
void Raster::sort_by_depth() {
  keys_.clear();
  for (std::size_t i = 0; i < boxes_.size(); ++i) {
    if (boxes_[i].x0 >= boxes_[i].x1) continue;
    std::uint32_t bits;
    std::memcpy(&bits, &splats_[i].depth, sizeof bits);
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
  candidate_begin_.resize(visible + 1);
  candidate_begin_[0] = 0;
  for (std::size_t k = 0; k < visible; ++k) {
    const Box& box = boxes_[by_depth_[k]];
    candidate_begin_[k + 1] = candidate_begin_[k] + (std::size_t)(box.x1 - box.x0) * (box.y1 - box.y0);
  }
  candidates_.resize(candidate_begin_[visible]);
  // Each chunk of splats counts its records a tile; a prefix sum over (tile, chunk) then gives every chunk its own
  // places in each tile's list, in depth order, whatever the number of threads.
  const std::size_t grain = std::max(kSplatGrain, (visible + 15) / 16);
  const std::size_t chunks = (visible + grain - 1) / grain;
  histogram_.assign(chunks * tiles, 0);
  const auto touched_blocks = kernels().touched_blocks;
  parallel_for(visible, grain, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* count = histogram_.data() + begin / grain * tiles;
    for (std::size_t k = begin; k < end; ++k) {
      const Splat2D& s = splats_[by_depth_[k]];
      const Box& box = boxes_[by_depth_[k]];
      Candidate* candidate = candidates_.data() + candidate_begin_[k];
      for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x, ++candidate) {
          candidate->mask = touched_blocks(s, (float)(x * kTile), (float)(y * kTile));
          count[(std::size_t)y * tiles_x_ + x] += candidate->mask != 0;
        }
    }
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
  order_.resize(total);
  masks_.resize(total);
  parallel_for(visible, grain, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* next = histogram_.data() + begin / grain * tiles;
    for (std::size_t k = begin; k < end; ++k) {
      const Box& box = boxes_[by_depth_[k]];
      Candidate* candidate = candidates_.data() + candidate_begin_[k];
      for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x, ++candidate) {
          candidate->record = kNoRecord;
          if (!candidate->mask) continue;
          candidate->record = next[(std::size_t)y * tiles_x_ + x]++;
          order_[candidate->record] = by_depth_[k];
          masks_[candidate->record] = candidate->mask;
        }
    }
  });
}

TileView Raster::tile(std::size_t index, const float* channels, int first_channel) const {
  const std::uint32_t begin = tile_begin_[index];
  TileView view;
  view.splats = splats_.data();
  view.order = order_.data() + begin;
  view.masks = masks_.data() + begin;
  view.count = (int)(tile_begin_[index + 1] - begin);
  view.x0 = (int)(index % tiles_x_) * kTile;
  view.y0 = (int)(index / tiles_x_) * kTile;
  view.width = camera_.width;
  view.height = camera_.height;
  view.channels = channels + first_channel;
  view.channel_stride = channel_count_;
  view.channel_count = std::min(channel_count_ - first_channel, kMaxChannels);
  view.channel_offset = first_channel;
  return view;
}

void Raster::forward(const SplatArrays& splats, const float* channels, int channel_count, const RasterCamera& camera,
                     float* image, float* alpha) {
  camera_ = camera;
  channel_count_ = channel_count;
  tiles_x_ = (camera.width + kTile - 1) / kTile;
  tiles_y_ = (camera.height + kTile - 1) / kTile;
  project_all(splats);
  sort_by_depth();
  bin();
  const std::size_t plane = (std::size_t)camera.width * camera.height;
  parallel_for((std::size_t)tiles_x_ * tiles_y_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t)
      for (int first = 0; first < channel_count_; first += kMaxChannels) {
        const TileView view = tile(t, channels, first);
        const std::size_t floats = (std::size_t)view.count * (8 + padded(view.channel_count) + 16);
        kernels().forward_tile(view, image + first * plane, alpha, scratch(floats));
      }
  });
}

void Raster::backward(const SplatArrays& splats, const float* channels, const float* image, const float* alpha,
                      const float* image_grad, const float* alpha_grad, const SplatGradients* out,
                      float* channels_grad) {
  const int stride = kGeometry + channel_count_;
  const std::size_t plane = (std::size_t)camera_.width * camera_.height;
  grads_.resize(order_.size() * stride);
  parallel_for((std::size_t)tiles_x_ * tiles_y_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      float* grads = grads_.data() + (std::size_t)tile_begin_[t] * stride;
      std::memset(grads, 0, (std::size_t)(tile_begin_[t + 1] - tile_begin_[t]) * stride * sizeof(float));
      for (int first = 0; first < channel_count_; first += kMaxChannels) {
        const TileView view = tile(t, channels, first);
        const std::size_t floats = (std::size_t)view.count * (8 + padded(view.channel_count));
        kernels().backward_tile(view, image + first * plane, alpha, image_grad + first * plane,
                                first == 0 ? alpha_grad : nullptr, out == nullptr, grads, stride, scratch(floats));
      }
    }
  });
  // A splat's gradient is the sum over its records, in the order in which it was binned. Splats are taken as they are
  // stored: neighbours in memory tend to be neighbours in space, and then share tiles and cache lines.
  rank_.assign(splats.size, kNoRecord);
  for (std::size_t k = 0; k < by_depth_.size(); ++k) rank_[by_depth_[k]] = (std::uint32_t)k;
  parallel_for(splats.size, kSplatGrain / 4, [&](std::size_t begin, std::size_t end) {
    float* sum = scratch(stride);
    for (std::size_t i = begin; i < end; ++i) {
      const std::uint32_t k = rank_[i];
      if (k == kNoRecord) continue;
      std::fill(sum, sum + stride, 0.0f);
      for (std::size_t c = candidate_begin_[k]; c < candidate_begin_[k + 1]; ++c) {
        if (candidates_[c].record == kNoRecord) continue;
        const float* from = grads_.data() + (std::size_t)candidates_[c].record * stride;
        for (int j = 0; j < stride; ++j) sum[j] += from[j];
      }
      std::copy(sum + kGeometry, sum + stride, channels_grad + i * channel_count_);
      if (out) project_backward(splats, i, camera_, splats_[i], sum, *out);
    }
  });
}

void Raster::median(std::int32_t* out) const {
  std::vector<float> found((std::size_t)camera_.width * camera_.height);
  parallel_for((std::size_t)tiles_x_ * tiles_y_, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      const TileView view = tile(t, nullptr, 0);
      kernels().median_tile(view, found.data(), scratch((std::size_t)view.count * (8 + 16)));
    }
  });
  for (std::size_t i = 0; i < found.size(); ++i) out[i] = (std::int32_t)found[i];
}

void Raster::visible(std::uint8_t* out) const {
  std::fill(out, out + boxes_.size(), (std::uint8_t)0);
  for (const auto i : by_depth_) out[i] = 1;
}

}  // namespace goc
