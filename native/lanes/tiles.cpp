// Tile kernels of the rasteriser: which blocks a splat touches, alpha blending, and its gradient.
#include "kernels.hpp"
#include "powers.hpp"

namespace goc::GOC_ISA {
namespace {

alignas(64) const float kLaneX[16] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
alignas(64) const float kLaneY[16] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
constexpr int kAhead = 6;  // records whose row is fetched before it is needed

// alpha of the 16 pixels, 0 where it is below 1/255. dx, dy: pixel minus splat.
GOC_INLINE Lanes alpha_of(const float* packed, Lanes dx, Lanes dy, Lanes& raw) {
  const Lanes along_x = fma(dx, packed[2], dy * packed[3]);
  const Lanes power = (packed[5] - dy * dy * packed[4]) - along_x * dx;
  raw = exp2_above_minus_8(power);
  return keep(power >= -kLog2Of255, min(raw, splat(kMaxAlpha)));
}

// T·(1 − α), of the bits that forward and backward both have. Never more than T: a pixel that is opaque once stays it,
// so that the sum of what comes waits for this product alone and for no comparison.
GOC_INLINE Lanes let_through(Lanes transmittance, Lanes a) {
  return fma(splat(0.0f) - a, transmittance, transmittance);
}

GOC_INLINE const float* row_of(const TileView& tile, int record) {
  return tile.rows + (std::size_t)tile.order[record] * tile.row_stride;
}

// The part of a block that lies inside the image.
struct Inside {
  int columns, rows;
};
GOC_INLINE Inside inside(const TileView& tile, int x, int y) {
  const int columns = tile.width - x, rows = tile.height - y;
  return {columns < kBlock ? columns : kBlock, rows < kBlock ? rows : kBlock};
}

GOC_INLINE Lanes load_block(const float* plane, int width, Inside in) {
  if (in.rows == kBlock && in.columns == kBlock) return load_rows(plane, width);
  alignas(64) float out[16] = {};
  for (int j = 0; j < in.rows; ++j)
    for (int i = 0; i < in.columns; ++i) out[j * kBlock + i] = plane[(std::size_t)j * width + i];
  return load(out);
}
GOC_INLINE void store_block(float* plane, int width, Inside in, Lanes values) {
  if (in.rows == kBlock && in.columns == kBlock) return store_rows(plane, width, values);
  alignas(64) float out[16];
  store(out, values);
  for (int j = 0; j < in.rows; ++j)
    for (int i = 0; i < in.columns; ++i) plane[(std::size_t)j * width + i] = out[j * kBlock + i];
}

// The splats that touch each block, near to far: list b starts at b·count. Fetches their rows on the way.
GOC_INLINE void list_blocks(const TileView& tile, std::uint32_t* lists, int* counts) {
  for (int r = 0; r < tile.count; ++r) {
    __builtin_prefetch(row_of(tile, r));
    for (std::uint32_t rest = tile.masks[r]; rest; rest &= rest - 1) {
      const int b = __builtin_ctz(rest);
      lists[b * tile.count + counts[b]++] = tile.order[r];
    }
  }
}

template <int C>
void forward(const TileView& tile, float* const* image, float* alpha, std::uint32_t* lists) {
  int counts[16] = {};
  list_blocks(tile, lists, counts);
  const float* channels = tile.rows + kPacked + tile.channel_offset;
  for (int b = 0; b < 16; ++b) {
    const int x = tile.x0 + (b % 4) * kBlock, y = tile.y0 + (b / 4) * kBlock;
    if (x >= tile.width || y >= tile.height) continue;
    const Lanes px = load(kLaneX) + (x + 0.5f), py = load(kLaneY) + (y + 0.5f);
    Lanes transmittance = splat(1.0f), total = splat(0.0f), colour[C];
    for (int c = 0; c < C; ++c) colour[c] = splat(0.0f);
    for (int i = 0; i < counts[b]; ++i) {
      const std::size_t at = (std::size_t)lists[b * tile.count + i] * tile.row_stride;
      const float *s = tile.rows + at, *v = channels + at;
      Lanes raw;
      const Lanes a = alpha_of(s, px - s[0], py - s[1], raw), taken = a * transmittance;
      transmittance = let_through(transmittance, a);
      const Mask alive = transmittance >= kMinTransmittance;
      const Lanes weight = keep(alive, taken);
      total = total + weight;
      for (int c = 0; c < C; ++c) colour[c] = fma(weight, v[c], colour[c]);
      if (!bits(alive)) break;
    }
    const Inside in = inside(tile, x, y);
    const std::size_t at = (std::size_t)y * tile.width + x;
    store_block(alpha + at, tile.width, in, total);
    for (int c = 0; c < C; ++c)
      if (c < tile.channel_count) store_block(image[c] + at, tile.width, in, colour[c]);
  }
}

// What backward carries along a block's rays, front to back.
template <int C>
struct alignas(64) Block {  // aligned: a 64-byte access across two cache lines costs several times more
  float transmittance[16], rest[16], alpha_grad[16], grad[C][16], px[16], py[16];
};

// Loads the upstream gradients; rest = Σ_i w_i v_i with v_i = grad·channels_i + alpha_grad, known from the image alone.
template <int C>
std::uint32_t begin_blocks(const TileView& tile, const float* const* image, const float* alpha,
                           const float* const* image_grad, const float* alpha_grad, Block<C>* blocks) {
  std::uint32_t alive = 0;
  for (int b = 0; b < 16; ++b) {
    const int x = tile.x0 + (b % 4) * kBlock, y = tile.y0 + (b / 4) * kBlock;
    if (x >= tile.width || y >= tile.height) continue;
    alive |= 1u << b;
    const Inside in = inside(tile, x, y);
    const std::size_t at = (std::size_t)y * tile.width + x;
    Lanes upstream = alpha_grad ? load_block(alpha_grad + at, tile.width, in) : splat(0.0f);
    Lanes rest = upstream * load_block(alpha + at, tile.width, in);
    store(blocks[b].alpha_grad, upstream);
    for (int c = 0; c < C; ++c) {
      Lanes g = splat(0.0f);
      if (c < tile.channel_count && image_grad[c]) {
        g = load_block(image_grad[c] + at, tile.width, in);
        rest = fma(g, load_block(image[c] + at, tile.width, in), rest);
      }
      store(blocks[b].grad[c], g);
    }
    // Pixels outside the image start opaque: nothing reaches them.
    store(blocks[b].transmittance,
          keep((load(kLaneX) <= in.columns - 1.0f) & (load(kLaneY) <= in.rows - 1.0f), splat(1.0f)));
    store(blocks[b].rest, rest);
    store(blocks[b].px, load(kLaneX) + (x + 0.5f));
    store(blocks[b].py, load(kLaneY) + (y + 0.5f));
  }
  return alive;
}

// Front-to-back gradient (paper Eq. 1): dL/dα_i = T_i v_i − (Σ_{j>i} w_j v_j)/(1 − α_i), where the sum behind i is what
// is left of `rest`: one scalar a pixel instead of one buffer a channel.
template <int C, bool kChannelsOnly>
void backward(const TileView& tile, const float* const* image, const float* alpha, const float* const* image_grad,
              const float* alpha_grad, float* grads, int grad_stride) {
  constexpr int kFloats = gradient_floats(C);
  Block<C> blocks[16];
  std::uint32_t alive = begin_blocks<C>(tile, image, alpha, image_grad, alpha_grad, blocks);
  for (int r = 0; r < tile.count; ++r) {
    float* out = grads + (std::size_t)tile.slots[r] * grad_stride;
    std::uint32_t touched = tile.masks[r] & alive;
    if (!touched) {
      for (int k = 0; k < kFloats; k += 16) store(out + k, splat(0.0f));
      continue;
    }
    if (r + kAhead < tile.count) {
      __builtin_prefetch(row_of(tile, r + kAhead));
      __builtin_prefetch(grads + (std::size_t)tile.slots[r + kAhead] * grad_stride, 1);
    }
    const float* row = row_of(tile, r);
    Lanes total[kFloats];
    for (int k = 0; k < kFloats; ++k) total[k] = splat(0.0f);
    for (; touched; touched &= touched - 1) {
      const int b = __builtin_ctz(touched);
      Block<C>& block = blocks[b];
      const float *s = reread(row), *v = s + kPacked + tile.channel_offset;
      const Lanes dx = load(block.px) - s[0], dy = load(block.py) - s[1];
      Lanes raw;
      const Lanes a = alpha_of(s, dx, dy, raw);
      const Lanes transmittance = load(block.transmittance), next = let_through(transmittance, a);
      const Mask open = next >= kMinTransmittance;
      const Lanes weight = keep(open, a * transmittance);
      store(block.transmittance, next);
      if (!bits(open)) alive &= ~(1u << b);
      // Two sums: one alone would wait for itself.
      Lanes value = kChannelsOnly ? splat(0.0f) : load(block.alpha_grad), other = splat(0.0f);
      for (int c = 0; c < C; ++c) {
        const Lanes g = load(block.grad[c]);
        total[kGeometry + c] = fma(weight, g, total[kGeometry + c]);
        if (!kChannelsOnly && c % 2 == 0) value = fma(g, v[c], value);
        if (!kChannelsOnly && c % 2 == 1) other = fma(g, v[c], other);
      }
      if (kChannelsOnly) continue;
      value = value + other;
      const Lanes rest = load(block.rest) - weight * value;
      store(block.rest, rest);
      // Times dα/d ln α = α; a capped alpha no longer depends on its power.
      const Lanes g = keep(open & (raw <= kMaxAlpha), a * (transmittance * value - rest * reciprocal(1.0f - a)));
      const Lanes gx = g * dx, gy = g * dy;
      total[0] = total[0] + g;
      total[1] = total[1] + gx;
      total[2] = total[2] + gy;
      total[3] = fma(gx, dx, total[3]);
      total[4] = fma(gx, dy, total[4]);
      total[5] = fma(gy, dy, total[5]);
    }
    for (int k = 0; k < kFloats; k += 16) store(out + k, sums(total + k));
  }
}

#define GOC_FOR_CHANNELS(CALL)                                                                     \
  switch (tile.channel_count) {                                                                    \
    case 1: return CALL(1);                                                                        \
    case 2: return CALL(2);                                                                        \
    case 3: return CALL(3);                                                                        \
    case 4: return CALL(4);                                                                        \
    case 5: return CALL(5);                                                                        \
    case 6: return CALL(6);                                                                        \
    case 7: return CALL(7);                                                                        \
    case 8: return CALL(8);                                                                        \
    default: break;                                                                                \
  }                                                                                                \
  if (tile.channel_count <= 12) return CALL(12);                                                   \
  if (tile.channel_count <= 16) return CALL(16);                                                   \
  if (tile.channel_count <= 24) return CALL(24);                                                   \
  return CALL(32);

}  // namespace

void forward_tile(const TileView& tile, float* const* image, float* alpha, std::uint32_t* scratch) {
#define GOC_CALL(C) forward<C>(tile, image, alpha, scratch)
  GOC_FOR_CHANNELS(GOC_CALL)
#undef GOC_CALL
}

void median_tile(const TileView& tile, float* median, std::uint32_t* scratch) {
  int counts[16] = {};
  list_blocks(tile, scratch, counts);
  for (int b = 0; b < 16; ++b) {
    const int x = tile.x0 + (b % 4) * kBlock, y = tile.y0 + (b / 4) * kBlock;
    if (x >= tile.width || y >= tile.height) continue;
    const Lanes px = load(kLaneX) + (x + 0.5f), py = load(kLaneY) + (y + 0.5f);
    Lanes transmittance = splat(1.0f), found = splat(-1.0f);
    for (int i = 0; i < counts[b]; ++i) {
      const std::uint32_t index = scratch[b * tile.count + i];
      const float* s = tile.rows + (std::size_t)index * tile.row_stride;
      Lanes raw;
      const Lanes next = transmittance * (1.0f - alpha_of(s, px - s[0], py - s[1], raw));
      const Mask crosses = (transmittance >= 0.5f) & (splat(0.5f) > next);
      found = select(crosses, splat((float)index), found);
      transmittance = next;
      if (!bits(transmittance >= 0.5f)) break;
    }
    store_block(median + (std::size_t)y * tile.width + x, tile.width, inside(tile, x, y), found);
  }
}

void backward_tile(const TileView& tile, const float* const* image, const float* alpha, const float* const* image_grad,
                   const float* alpha_grad, bool channels_only, float* grads, int grad_stride) {
  if (channels_only) {
#define GOC_CALL(C) backward<C, true>(tile, image, alpha, image_grad, alpha_grad, grads, grad_stride)
    GOC_FOR_CHANNELS(GOC_CALL)
#undef GOC_CALL
  }
#define GOC_CALL(C) backward<C, false>(tile, image, alpha, image_grad, alpha_grad, grads, grad_stride)
  GOC_FOR_CHANNELS(GOC_CALL)
#undef GOC_CALL
}

}  // namespace goc::GOC_ISA
