// Sixteen float lanes, the pixels of a 4×4 block, in whatever registers the instruction set has.
// Included only by the kernels of native/lanes, which are compiled once for each GOC_ISA. Everything here is
// static or in the namespace of the instruction set: a function shared with another translation unit could be
// replaced by its AVX-512 twin at link time and crash on older machines. For the same reason no std templates.
#pragma once
#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif
#include <cstdint>

#define GOC_INLINE static inline __attribute__((always_inline))

namespace goc::GOC_ISA {

#if defined(__AVX512F__)
constexpr int kWidth = 16;
#elif defined(__AVX__)
constexpr int kWidth = 8;
#else
constexpr int kWidth = 4;
#endif
constexpr int kParts = 16 / kWidth;

typedef float Part __attribute__((vector_size(kWidth * 4)));
typedef std::int32_t IntPart __attribute__((vector_size(kWidth * 4)));

alignas(64) static const float kIota[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

struct Lanes {
  Part part[kParts];
};
#if defined(__AVX512F__)
typedef __mmask16 PartMask;
#else
typedef IntPart PartMask;  // all ones or all zeros a lane
#endif
struct Mask {
  PartMask part[kParts];
};
struct IntLanes {
  IntPart part[kParts];
};

// Does something with every part. Written out, not a loop: GCC takes a struct of vectors apart into registers only
// where the indices are constants early on; in a loop every operation goes through memory (backward 2.6× slower on AVX2).
#define GOC_PART(INDEX, ...) { constexpr int p = INDEX; __VA_ARGS__; }
#if defined(__AVX512F__)
#define GOC_EACH(...) GOC_PART(0, __VA_ARGS__)
#elif defined(__AVX__)
#define GOC_EACH(...) GOC_PART(0, __VA_ARGS__) GOC_PART(1, __VA_ARGS__)
#else
#define GOC_EACH(...) \
  GOC_PART(0, __VA_ARGS__) GOC_PART(1, __VA_ARGS__) GOC_PART(2, __VA_ARGS__) GOC_PART(3, __VA_ARGS__)
#endif

GOC_INLINE Lanes splat(float x) {
  Lanes out;
  GOC_EACH(out.part[p] = Part{} + x)
  return out;
}
GOC_INLINE Lanes load(const float* from) {
  Lanes out;
  GOC_EACH(__builtin_memcpy(&out.part[p], from + p * kWidth, sizeof(Part)))
  return out;
}
GOC_INLINE void store(float* to, Lanes x) { GOC_EACH(__builtin_memcpy(to + p * kWidth, &x.part[p], sizeof(Part))) }

// The first `count` of sixteen; the others are 0, and their memory is not touched.
GOC_INLINE Lanes load_some(const float* from, int count) {
  if (count == 16) return load(from);
  alignas(64) float out[16] = {};
  for (int l = 0; l < count; ++l) out[l] = from[l];
  return load(out);
}
GOC_INLINE void store_some(float* to, int count, Lanes x) {
  if (count == 16) return store(to, x);
  alignas(64) float out[16];
  store(out, x);
  for (int l = 0; l < count; ++l) to[l] = out[l];
}

// The same pointer, but the compiler may not know what it read there before. In a loop it would keep a vector for each
// number it reads, in memory when registers run out: 64 bytes stored and loaded instead of four loaded.
GOC_INLINE const float* reread(const float* from) {
  asm("" : "+r"(from));
  return from;
}

GOC_INLINE Lanes operator+(Lanes a, Lanes b) { GOC_EACH(a.part[p] += b.part[p]) return a; }
GOC_INLINE Lanes operator-(Lanes a, Lanes b) { GOC_EACH(a.part[p] -= b.part[p]) return a; }
GOC_INLINE Lanes operator*(Lanes a, Lanes b) { GOC_EACH(a.part[p] *= b.part[p]) return a; }
GOC_INLINE Lanes operator/(Lanes a, Lanes b) { GOC_EACH(a.part[p] /= b.part[p]) return a; }
GOC_INLINE Lanes operator+(Lanes a, float b) { GOC_EACH(a.part[p] += b) return a; }
GOC_INLINE Lanes operator-(Lanes a, float b) { GOC_EACH(a.part[p] -= b) return a; }
GOC_INLINE Lanes operator-(float a, Lanes b) { GOC_EACH(b.part[p] = a - b.part[p]) return b; }
GOC_INLINE Lanes operator*(Lanes a, float b) { GOC_EACH(a.part[p] *= b) return a; }
// a·b + c, one fused instruction where there is one (-ffp-contract=fast).
GOC_INLINE Lanes fma(Lanes a, Lanes b, Lanes c) { GOC_EACH(c.part[p] = a.part[p] * b.part[p] + c.part[p]) return c; }
GOC_INLINE Lanes fma(Lanes a, float b, Lanes c) { GOC_EACH(c.part[p] = a.part[p] * b + c.part[p]) return c; }

#if defined(__AVX512F__)
// GCC would make such a mask a vector again to take its bits.
#define GOC_COMPARE(OPERATOR, HOW) \
  GOC_INLINE Mask operator OPERATOR(Lanes a, Lanes b) { return {{_mm512_cmp_ps_mask(a.part[0], b.part[0], HOW)}}; }
GOC_COMPARE(==, _CMP_EQ_OQ)
GOC_COMPARE(>=, _CMP_GE_OQ)
GOC_COMPARE(<=, _CMP_LE_OQ)
GOC_COMPARE(>, _CMP_GT_OQ)
GOC_INLINE Mask operator&(Mask a, Mask b) { return {{(__mmask16)(a.part[0] & b.part[0])}}; }
GOC_INLINE Mask operator|(Mask a, Mask b) { return {{(__mmask16)(a.part[0] | b.part[0])}}; }
GOC_INLINE Mask operator~(Mask a) { return {{(__mmask16)~a.part[0]}}; }
GOC_INLINE Lanes select(Mask m, Lanes yes, Lanes no) {
  return {{_mm512_mask_mov_ps(no.part[0], m.part[0], yes.part[0])}};
}
GOC_INLINE Lanes keep(Mask m, Lanes x) { return {{_mm512_maskz_mov_ps(m.part[0], x.part[0])}}; }
#else
#define GOC_COMPARE(OPERATOR) \
  GOC_INLINE Mask operator OPERATOR(Lanes a, Lanes b) { Mask m; GOC_EACH(m.part[p] = a.part[p] OPERATOR b.part[p]) return m; }
GOC_COMPARE(==)
GOC_COMPARE(>=)
GOC_COMPARE(<=)
GOC_COMPARE(>)
GOC_INLINE Mask operator&(Mask a, Mask b) { GOC_EACH(a.part[p] &= b.part[p]) return a; }
GOC_INLINE Mask operator|(Mask a, Mask b) { GOC_EACH(a.part[p] |= b.part[p]) return a; }
GOC_INLINE Mask operator~(Mask a) { GOC_EACH(a.part[p] = ~a.part[p]) return a; }
GOC_INLINE Lanes select(Mask m, Lanes yes, Lanes no) {
  GOC_EACH(yes.part[p] = m.part[p] ? yes.part[p] : no.part[p])
  return yes;
}
GOC_INLINE Lanes keep(Mask m, Lanes x) { return select(m, x, splat(0.0f)); }
#endif
#undef GOC_COMPARE
GOC_INLINE Mask operator>=(Lanes a, float b) { return a >= splat(b); }
GOC_INLINE Mask operator<=(Lanes a, float b) { return a <= splat(b); }

// The second where one is NaN.
GOC_INLINE Part part_min(Part a, Part b) {
#if defined(__AVX512F__)
  return _mm512_maskz_min_ps(0xffff, a, b);
#elif defined(__AVX__)
  return _mm256_min_ps(a, b);
#elif defined(__x86_64__)
  return _mm_min_ps(a, b);
#else
  return a < b ? a : b;
#endif
}
GOC_INLINE Part part_max(Part a, Part b) {
#if defined(__AVX512F__)
  return _mm512_maskz_max_ps(0xffff, a, b);
#elif defined(__AVX__)
  return _mm256_max_ps(a, b);
#elif defined(__x86_64__)
  return _mm_max_ps(a, b);
#else
  return a > b ? a : b;
#endif
}
GOC_INLINE Lanes min(Lanes a, Lanes b) { GOC_EACH(a.part[p] = part_min(a.part[p], b.part[p])) return a; }
GOC_INLINE Lanes max(Lanes a, Lanes b) { GOC_EACH(a.part[p] = part_max(a.part[p], b.part[p])) return a; }

GOC_INLINE Part part_sqrt(Part x) {
#if defined(__AVX512F__)
  return _mm512_maskz_sqrt_ps(0xffff, x);  // _mm512_sqrt_ps warns in GCC 12
#elif defined(__AVX__)
  return _mm256_sqrt_ps(x);
#elif defined(__x86_64__)
  return _mm_sqrt_ps(x);
#elif defined(__aarch64__)
  return vsqrtq_f32(x);
#else
  return Part{__builtin_sqrtf(x[0]), __builtin_sqrtf(x[1]), __builtin_sqrtf(x[2]), __builtin_sqrtf(x[3])};
#endif
}
GOC_INLINE Lanes sqrt(Lanes x) { GOC_EACH(x.part[p] = part_sqrt(x.part[p])) return x; }

// 1/x, relative error 2e-7: a table and one step of Newton where there is such a table.
GOC_INLINE Part part_reciprocal(Part x) {
#if defined(__AVX512F__)
  const Part guess = _mm512_maskz_rcp14_ps(0xffff, x);
  return guess * (2.0f - x * guess);
#elif defined(__AVX__)
  const Part guess = _mm256_rcp_ps(x);
  return guess * (2.0f - x * guess);
#else
  return 1.0f / x;
#endif
}
GOC_INLINE Lanes reciprocal(Lanes x) { GOC_EACH(x.part[p] = part_reciprocal(x.part[p])) return x; }

GOC_INLINE std::uint32_t part_bits(PartMask m) {
#if defined(__AVX512F__)
  return m;
#elif defined(__AVX__)
  return _mm256_movemask_ps((__m256)m);
#elif defined(__x86_64__)
  return _mm_movemask_ps((__m128)m);
#else
  return (m[0] & 1) | (m[1] & 2) | (m[2] & 4) | (m[3] & 8);
#endif
}
// One bit a lane.
GOC_INLINE std::uint32_t bits(Mask m) {
  std::uint32_t out = 0;
  GOC_EACH(out |= part_bits(m.part[p]) << (p * kWidth))
  return out;
}

GOC_INLINE IntLanes operator+(IntLanes a, IntLanes b) { GOC_EACH(a.part[p] += b.part[p]) return a; }
GOC_INLINE IntLanes operator*(IntLanes a, int b) { GOC_EACH(a.part[p] *= b) return a; }
GOC_INLINE IntLanes operator&(IntLanes a, int b) { GOC_EACH(a.part[p] &= b) return a; }
GOC_INLINE IntLanes operator<<(IntLanes a, int b) { GOC_EACH(a.part[p] <<= b) return a; }
GOC_INLINE IntLanes operator>>(IntLanes a, int b) { GOC_EACH(a.part[p] >>= b) return a; }
GOC_INLINE IntLanes splat_int(int x) {
  IntLanes out;
  GOC_EACH(out.part[p] = IntPart{} + x)
  return out;
}
GOC_INLINE void store(std::int32_t* to, IntLanes x) {
  GOC_EACH(__builtin_memcpy(to + p * kWidth, &x.part[p], sizeof(IntPart)))
}
#if defined(__AVX512F__)
GOC_INLINE Mask operator==(IntLanes a, IntLanes b) {
  return {{_mm512_cmpeq_epi32_mask((__m512i)a.part[0], (__m512i)b.part[0])}};
}
GOC_INLINE Mask operator>=(IntLanes a, IntLanes b) {
  return {{_mm512_cmpge_epi32_mask((__m512i)a.part[0], (__m512i)b.part[0])}};
}
#else
GOC_INLINE Mask operator==(IntLanes a, IntLanes b) { Mask m; GOC_EACH(m.part[p] = a.part[p] == b.part[p]) return m; }
GOC_INLINE Mask operator>=(IntLanes a, IntLanes b) { Mask m; GOC_EACH(m.part[p] = a.part[p] >= b.part[p]) return m; }
#endif
GOC_INLINE Mask operator==(IntLanes a, int b) { return a == splat_int(b); }
GOC_INLINE Mask operator>=(IntLanes a, int b) { return a >= splat_int(b); }
// Towards zero; x must fit.
GOC_INLINE IntLanes truncate(Lanes x) {
  IntLanes out;
  GOC_EACH(out.part[p] = __builtin_convertvector(x.part[p], IntPart))
  return out;
}
GOC_INLINE Lanes to_float(IntLanes x) {
  Lanes out;
  GOC_EACH(out.part[p] = __builtin_convertvector(x.part[p], Part))
  return out;
}

GOC_INLINE IntPart bits_of(Part x) {
  IntPart out;
  __builtin_memcpy(&out, &x, sizeof out);
  return out;
}
GOC_INLINE Part part_of(IntPart x) {
  Part out;
  __builtin_memcpy(&out, &x, sizeof out);
  return out;
}

// from + bytes·index of the lanes in the mask, four bytes each, which need not be aligned; `no` of the others, whose
// memory is not touched.
template <int bytes>
GOC_INLINE IntPart part_gather(const void* from, IntPart index, PartMask mask, IntPart no) {
#if defined(__AVX512F__)
  return (IntPart)_mm512_mask_i32gather_epi32((__m512i)no, mask, (__m512i)index, from, bytes);
#elif defined(__AVX2__)
  return (IntPart)_mm256_mask_i32gather_epi32((__m256i)no, (const int*)from, (__m256i)index, (__m256i)mask, bytes);
#else
  for (int l = 0; l < kWidth; ++l)
    if (mask[l]) {
      std::int32_t word;
      __builtin_memcpy(&word, (const char*)from + (std::ptrdiff_t)bytes * index[l], sizeof word);
      no[l] = word;
    }
  return no;
#endif
}
GOC_INLINE Lanes gather(const float* from, IntLanes index, Mask mask, Lanes no) {
  GOC_EACH(no.part[p] = part_of(part_gather<4>(from, index.part[p], mask.part[p], bits_of(no.part[p]))))
  return no;
}
// Element index[l] in the lower half of lane l, the one after it in the upper; 0 outside the mask.
GOC_INLINE IntLanes gather_pair(const std::int16_t* from, IntLanes index, Mask mask) {
  GOC_EACH(index.part[p] = part_gather<2>(from, index.part[p], mask.part[p], IntPart{}))
  return index;
}
// Elements of a narrow array, which has four bytes at least. The word read ends with the element, so that nothing past
// the array is touched; that of element 0 starts with it.
GOC_INLINE IntLanes gather_short(const std::int16_t* from, IntLanes index, Mask mask) {
  GOC_EACH(const IntPart start = index.part[p] == 0; const IntPart before = index.part[p] - 1 - start;
           const IntPart word = part_gather<2>(from, before, mask.part[p], IntPart{});
           index.part[p] = (start ? word << 16 : word) >> 16;)
  return index;
}
// Three bytes each: the first in the lowest eight bits.
GOC_INLINE IntLanes gather_rgb(const std::uint8_t* from, IntLanes index, Mask mask) {
  GOC_EACH(const IntPart start = index.part[p] == 0; const IntPart before = 3 * index.part[p] - 1 - start;
           const IntPart word = part_gather<1>(from, before, mask.part[p], IntPart{});
           index.part[p] = (start ? word : word >> 8) & 0xffffff;)
  return index;
}
typedef float Quad __attribute__((vector_size(16)));
GOC_INLINE Quad load_quad(const float* from) {
  Quad out;
  __builtin_memcpy(&out, from, sizeof out);
  return out;
}
GOC_INLINE void store_quad(float* to, Quad x) { __builtin_memcpy(to, &x, sizeof x); }

GOC_INLINE float sum(Lanes x) {
  Part all = x.part[0];
  for (int p = 1; p < kParts; ++p) all += x.part[p];
  Quad total{};
  for (int q = 0; q < kWidth / 4; ++q) {
    Quad quad;
    __builtin_memcpy(&quad, (const char*)&all + q * sizeof quad, sizeof quad);
    total += quad;
  }
  return (total[0] + total[1]) + (total[2] + total[3]);
}

// Four rows of four floats, `stride` apart, and back.
GOC_INLINE Lanes load_rows(const float* from, long stride) {
  const Quad a = load_quad(from), b = load_quad(from + stride), c = load_quad(from + 2 * stride);
  const Quad d = load_quad(from + 3 * stride);
  Lanes out;
#if defined(__AVX__)
  typedef float Oct __attribute__((vector_size(32)));
  const Oct ab = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
  const Oct cd = __builtin_shufflevector(c, d, 0, 1, 2, 3, 4, 5, 6, 7);
#if defined(__AVX512F__)
  out.part[0] = __builtin_shufflevector(ab, cd, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#else
  out.part[0] = ab, out.part[1] = cd;
#endif
#else
  out.part[0] = a, out.part[1] = b, out.part[2] = c, out.part[3] = d;
#endif
  return out;
}
GOC_INLINE void store_rows(float* to, long stride, Lanes x) {
#if defined(__AVX512F__)
  const Part all = x.part[0];
  store_quad(to, __builtin_shufflevector(all, all, 0, 1, 2, 3));
  store_quad(to + stride, __builtin_shufflevector(all, all, 4, 5, 6, 7));
  store_quad(to + 2 * stride, __builtin_shufflevector(all, all, 8, 9, 10, 11));
  store_quad(to + 3 * stride, __builtin_shufflevector(all, all, 12, 13, 14, 15));
#elif defined(__AVX__)
  store_quad(to, __builtin_shufflevector(x.part[0], x.part[0], 0, 1, 2, 3));
  store_quad(to + stride, __builtin_shufflevector(x.part[0], x.part[0], 4, 5, 6, 7));
  store_quad(to + 2 * stride, __builtin_shufflevector(x.part[1], x.part[1], 0, 1, 2, 3));
  store_quad(to + 3 * stride, __builtin_shufflevector(x.part[1], x.part[1], 4, 5, 6, 7));
#else
  store_quad(to, x.part[0]), store_quad(to + stride, x.part[1]);
  store_quad(to + 2 * stride, x.part[2]), store_quad(to + 3 * stride, x.part[3]);
#endif
}

// Sixteen horizontal sums at once: lane i of the result is the sum of x[i]. Every step halves what is left of each sum
// and brings two vectors into one; first within quarters of a register, which is quick.
#if defined(__AVX512F__)
#define GOC_SHUFFLED(A, B, I, J, K, L) \
  __builtin_shufflevector(A, B, I, J, K, L, I + 4, J + 4, K + 4, L + 4, I + 8, J + 8, K + 8, L + 8, I + 12, J + 12, K + 12, L + 12)
constexpr int kSecond = 16;  // index of the second operand's first element
#elif defined(__AVX__)
#define GOC_SHUFFLED(A, B, I, J, K, L) __builtin_shufflevector(A, B, I, J, K, L, I + 4, J + 4, K + 4, L + 4)
constexpr int kSecond = 8;
#else
#define GOC_SHUFFLED(A, B, I, J, K, L) __builtin_shufflevector(A, B, I, J, K, L)
constexpr int kSecond = 4;
#endif
GOC_INLINE Part halve2(Part a, Part b) {
  return GOC_SHUFFLED(a, b, 0, kSecond, 1, kSecond + 1) + GOC_SHUFFLED(a, b, 2, kSecond + 2, 3, kSecond + 3);
}
GOC_INLINE Part halve1(Part a, Part b) {
  return GOC_SHUFFLED(a, b, 0, 1, kSecond, kSecond + 1) + GOC_SHUFFLED(a, b, 2, 3, kSecond + 2, kSecond + 3);
}
#undef GOC_SHUFFLED
// The sum of the parts of x.
GOC_INLINE Part folded(Lanes x) {
  Part out = x.part[0];
  GOC_EACH(if (p > 0) out += x.part[p])
  return out;
}
// Four sums, spread over the quarters of a part.
GOC_INLINE Part quarters(const Lanes* x) {
  return halve1(halve2(folded(x[0]), folded(x[1])), halve2(folded(x[2]), folded(x[3])));
}
GOC_INLINE Lanes sums(const Lanes* x) {
  const Part a = quarters(x), b = quarters(x + 4), c = quarters(x + 8), d = quarters(x + 12);
  Lanes out;
#if defined(__AVX512F__)
  const auto halve4 = [](Part left, Part right) __attribute__((always_inline)) {
    return __builtin_shufflevector(left, right, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27) +
           __builtin_shufflevector(left, right, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31);
  };
  out.part[0] = halve4(halve4(a, b), halve4(c, d));
#elif defined(__AVX__)
  const auto halve4 = [](Part left, Part right) __attribute__((always_inline)) {
    return __builtin_shufflevector(left, right, 0, 1, 2, 3, 8, 9, 10, 11) +
           __builtin_shufflevector(left, right, 4, 5, 6, 7, 12, 13, 14, 15);
  };
  out.part[0] = halve4(a, b), out.part[1] = halve4(c, d);
#else
  out.part[0] = a, out.part[1] = b, out.part[2] = c, out.part[3] = d;
#endif
  return out;
}

}  // namespace goc::GOC_ISA
