// Which tiles each splat touches, and the splats of each tile from near to far.
#pragma once
#include <cstdint>
#include <vector>

#include "lanes.hpp"

namespace goc {

// Splats come in chunks that fill side by side; then `scatter`; then `sort_tile` for each tile, again side by side.
// Records are numbered twice: by tile, near to far, and by splat (their slot), where their gradients lie together.
class Bins {
 public:
  struct Touch {  // a tile that a splat reaches
    std::uint32_t tile;
    std::uint32_t mask;
  };
  class Chunk {
   public:
    // Splat i, the next of this chunk, with lane l's footprint; whether it touches any tile. `i` counts in all.
    bool add(Bins& bins, std::size_t i, const Splat2D& splat, const Footprints& footprints, int l);
    void skip(Bins& bins, std::size_t i) { bins.ranges_[i] = {count_, 0, 0}; }
    void close();  // after its last splat

   private:
    friend class Bins;
    Touch* room(std::size_t more);
    std::vector<Touch> touches_;  // the first `count_` are meant
    std::uint32_t count_ = 0;
    std::vector<std::uint32_t> next_;  // of each tile: its records; in `scatter`, where the next of them goes
  };

  void begin(std::size_t splats, int width, int height);
  std::size_t grain() const { return grain_; }  // splats of a chunk
  Chunk& chunk_of(std::size_t i) { return chunks_[i / grain_]; }

  void scatter();
  void sort_tile(std::size_t tile);

  std::size_t tiles() const { return (std::size_t)tiles_x_ * tiles_y_; }
  std::size_t records() const { return order_.size(); }
  std::size_t blocks() const;  // (record, block of 4×4 pixels) pairs
  std::size_t bytes() const;
  std::uint32_t touched(std::size_t i) const { return ranges_[i].count; }
  // The first of splat i's slots.
  std::size_t first_slot(std::size_t i) const { return first_slot_[i / grain_] + ranges_[i].begin; }
  // Fills what a view of a tile says about its records and its place.
  void view(std::size_t tile, TileView& view) const;

 private:
  struct Range {  // of a splat's touches in its chunk
    std::uint32_t begin, count, depth;  // depth: the bits of a positive float, which sort as it does
  };
  struct Record {
    std::uint32_t depth, splat, slot, mask;
  };

  int tiles_x_ = 0, tiles_y_ = 0;
  std::size_t size_ = 0, grain_ = 1;
  std::vector<Chunk> chunks_;
  std::vector<std::uint32_t> first_slot_;  // of each chunk
  std::vector<Range> ranges_;              // of each splat
  std::vector<std::uint32_t> tile_begin_;
  std::vector<Record> unsorted_;           // by tile, each in the order of the splats
  std::vector<std::uint32_t> order_, slots_;
  std::vector<std::uint16_t> masks_;
};

}  // namespace goc
