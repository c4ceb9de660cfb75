#include "bins.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kLeastGrain = 1024, kMostChunks = 32;
constexpr int kDigit = 8, kDigits = 1 << kDigit;
constexpr std::size_t kFew = 24;  // so many are sorted by insertion

constexpr int kBlocks = kTile / kBlock;

constexpr std::uint32_t every_row(std::uint32_t row) { return row * 0x1111; }

// A 4×4 window of blocks that starts x columns and y rows after a tile does, bit 4·row + column. Its blocks in that tile:
constexpr std::uint32_t columns_here(std::uint32_t window, int x) { return window << x & every_row(0xf << x & 0xf); }
constexpr std::uint32_t rows_here(std::uint32_t window, int y) { return window << 4 * y & 0xffff; }
// and in the next one.
constexpr std::uint32_t columns_next(std::uint32_t window, int x) { return window >> (4 - x) & every_row((1 << x) - 1); }
constexpr std::uint32_t rows_next(std::uint32_t window, int y) { return window >> 4 * (4 - y); }

// Sorts `items` by their upper halves, whose bits above `bits` are equal; stable. Returns where the result is: one of both.
std::uint64_t* sorted(std::uint64_t* items, std::uint64_t* spare, std::size_t count, int bits) {
  if (count <= kFew) {
    for (std::size_t k = 1; k < count; ++k) {
      const std::uint64_t item = items[k];
      std::size_t at = k;
      for (; at && items[at - 1] > item; --at) items[at] = items[at - 1];
      items[at] = item;
    }
    return items;
  }
  for (int shift = 32; shift < 32 + bits; shift += kDigit) {
    std::uint32_t start[kDigits + 1] = {};
    for (std::size_t k = 0; k < count; ++k) ++start[(items[k] >> shift & (kDigits - 1)) + 1];
    for (int d = 0; d < kDigits; ++d) start[d + 1] += start[d];
    for (std::size_t k = 0; k < count; ++k) spare[start[items[k] >> shift & (kDigits - 1)]++] = items[k];
    std::swap(items, spare);
  }
  return items;
}

}  // namespace

void Bins::begin(std::size_t splats, int width, int height) {
  tiles_x_ = (width + kTile - 1) / kTile;
  tiles_y_ = (height + kTile - 1) / kTile;
  size_ = splats;
  grain_ = std::max(kLeastGrain, (splats + kMostChunks - 1) / kMostChunks + 15) / 16 * 16;
  chunks_.resize((splats + grain_ - 1) / grain_);
  for (Chunk& chunk : chunks_) {
    chunk.count_ = 0;
    chunk.next_.assign(tiles(), 0);
  }
  ranges_.resize(splats);
}

Bins::Touch* Bins::Chunk::room(std::size_t more) {
  if (touches_.size() < count_ + more) touches_.resize((count_ + more) * 3 / 2 + kLeastGrain);
  return touches_.data() + count_;
}

bool Bins::Chunk::add(Bins& bins, std::size_t i, const Splat2D& s, const Footprints& footprints, int l) {
  const int x0 = footprints.first_x[l], x1 = footprints.last_x[l];
  const int y0 = footprints.first_y[l], y1 = footprints.last_y[l];
  const int across = bins.tiles_x_;
  const std::uint32_t before = count_;
  if (x1 - x0 <= kBlocks && y1 - y0 <= kBlocks) {
    // Most splats: one window of 4×4 blocks holds them, which lies in up to four tiles. No branches: they would be
    // guessed wrong half of the time. What lies outside the image is cut off the window with the box.
    const std::uint32_t box = every_row((1u << (x1 - x0)) - 1) & ((1u << 4 * (y1 - y0)) - 1);
    const std::uint32_t window = footprints.window[l] & box;
    const std::uint32_t tile = y0 / kBlocks * across + x0 / kBlocks;
    const std::uint32_t left = columns_here(window, x0 % kBlocks), right = columns_next(window, x0 % kBlocks);
    Touch* touches = room(4);
    std::uint32_t found = 0;
    const auto put = [&](std::uint32_t where, std::uint32_t mask) {
      touches[found] = {where, mask};
      found += mask != 0;
    };
    put(tile, rows_here(left, y0 % kBlocks)), put(tile + 1, rows_here(right, y0 % kBlocks));
    put(tile + across, rows_next(left, y0 % kBlocks)), put(tile + across + 1, rows_next(right, y0 % kBlocks));
    count_ += found;
  } else {
    for (int y = y0 / kBlocks; y * kBlocks < y1; ++y)
      for (int x = x0 / kBlocks; x * kBlocks < x1; ++x)
        if (const std::uint32_t mask = kernels().touched_blocks(s, footprints.slope_x[l], footprints.slope_y[l],
                                                                x * kTile, y * kTile))
          *room(1) = {(std::uint32_t)(y * across + x), mask}, ++count_;
  }
  std::uint32_t depth;
  std::memcpy(&depth, &s.depth, sizeof depth);
  bins.ranges_[i] = {before, count_ - before, depth};
  return count_ != before;
}

void Bins::Chunk::close() {
  for (std::uint32_t k = 0; k < count_; ++k) ++next_[touches_[k].tile];
}

void Bins::scatter() {
  // The sum over (tile, chunk) before each gives every chunk its own places in each tile's list, in the order of the
  // splats, whatever the number of threads.
  tile_begin_.resize(tiles() + 1);
  std::uint32_t total = 0;
  for (std::size_t t = 0; t < tiles(); ++t) {
    tile_begin_[t] = total;
    for (Chunk& chunk : chunks_) {
      const std::uint32_t count = chunk.next_[t];
      chunk.next_[t] = total;
      total += count;
    }
  }
  tile_begin_[tiles()] = total;
  first_slot_.resize(chunks_.size());
  std::uint32_t slots = 0;
  for (std::size_t c = 0; c < chunks_.size(); ++c) first_slot_[c] = slots, slots += chunks_[c].count_;
  unsorted_.resize(total), order_.resize(total), slots_.resize(total), masks_.resize(total);
  parallel_for(size_, grain_, [&](std::size_t begin, std::size_t end) {
    Chunk& chunk = chunk_of(begin);
    const Touch* touch = chunk.touches_.data();
    std::uint32_t slot = first_slot_[begin / grain_];
    for (std::size_t i = begin; i < end; ++i)
      for (std::uint32_t k = 0; k < ranges_[i].count; ++k, ++touch, ++slot)
        unsorted_[chunk.next_[touch->tile]++] = {ranges_[i].depth, (std::uint32_t)i, slot, touch->mask};
  });
}

void Bins::sort_tile(std::size_t tile) {
  thread_local std::vector<std::uint64_t> both;
  const std::uint32_t begin = tile_begin_[tile];
  const std::size_t count = tile_begin_[tile + 1] - begin;
  if (!count) return;
  if (both.size() < 2 * count) both.resize(3 * count);
  const Record* records = unsorted_.data() + begin;
  std::uint32_t near = records[0].depth, far = near;
  for (std::size_t k = 1; k < count; ++k)
    near = std::min(near, records[k].depth), far = std::max(far, records[k].depth);
  for (std::size_t k = 0; k < count; ++k) both[k] = (std::uint64_t)(records[k].depth - near) << 32 | k;
  const std::uint64_t* order = sorted(both.data(), both.data() + count, count, std::bit_width(far - near));
  for (std::size_t k = 0; k < count; ++k) {
    const Record& record = records[(std::uint32_t)order[k]];
    order_[begin + k] = record.splat, slots_[begin + k] = record.slot, masks_[begin + k] = (std::uint16_t)record.mask;
  }
}

void Bins::view(std::size_t tile, TileView& view) const {
  const std::uint32_t begin = tile_begin_[tile];
  view.order = order_.data() + begin;
  view.masks = masks_.data() + begin;
  view.slots = slots_.data() + begin;
  view.count = (int)(tile_begin_[tile + 1] - begin);
  view.x0 = (int)(tile % tiles_x_) * kTile;
  view.y0 = (int)(tile / tiles_x_) * kTile;
}

std::size_t Bins::blocks() const {
  std::size_t total = 0;
  for (const auto mask : masks_) total += (std::size_t)std::popcount(mask);
  return total;
}

std::size_t Bins::bytes() const {
  const auto of = [](const auto& buffer) { return buffer.capacity() * sizeof(buffer[0]); };
  std::size_t total = of(chunks_) + of(first_slot_) + of(ranges_) + of(tile_begin_) + of(unsorted_) + of(order_) +
                      of(slots_) + of(masks_);
  for (const Chunk& chunk : chunks_) total += of(chunk.touches_) + of(chunk.next_);
  return total;
}

}  // namespace goc
