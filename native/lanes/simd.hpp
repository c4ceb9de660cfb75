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

struct Lanes {
  Part part[kParts];
};
struct Mask {
  IntPart part[kParts];  // all ones or all zeros a lane
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

GOC_INLINE Mask operator>=(Lanes a, float b) { Mask m; GOC_EACH(m.part[p] = a.part[p] >= b) return m; }
GOC_INLINE Mask operator<=(Lanes a, float b) { Mask m; GOC_EACH(m.part[p] = a.part[p] <= b) return m; }
GOC_INLINE Mask operator>(Lanes a, Lanes b) { Mask m; GOC_EACH(m.part[p] = a.part[p] > b.part[p]) return m; }
GOC_INLINE Mask operator&(Mask a, Mask b) { GOC_EACH(a.part[p] &= b.part[p]) return a; }

GOC_INLINE Lanes select(Mask m, Lanes yes, Lanes no) {
  GOC_EACH(yes.part[p] = m.part[p] ? yes.part[p] : no.part[p])
  return yes;
}
GOC_INLINE Lanes keep(Mask m, Lanes x) { return select(m, x, splat(0.0f)); }

GOC_INLINE Lanes min(Lanes a, Lanes b) { GOC_EACH(a.part[p] = a.part[p] < b.part[p] ? a.part[p] : b.part[p]) return a; }
GOC_INLINE Lanes max(Lanes a, Lanes b) { GOC_EACH(a.part[p] = a.part[p] > b.part[p] ? a.part[p] : b.part[p]) return a; }

GOC_INLINE std::uint32_t part_bits(IntPart m) {
#if defined(__AVX512F__)
  return _mm512_cmplt_epi32_mask((__m512i)m, _mm512_setzero_si512());
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

typedef float Quad __attribute__((vector_size(16)));

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

// 2^x for x in [-8, 0], smaller x counts as -8: a polynomial of 2^(x/8), squared three times (relative error 3e-6).
// No bit tricks, so that no compiler flag can break it.
GOC_INLINE Lanes exp2_above_minus_8(Lanes x) {
  const Lanes y = max(x, splat(-8.0f)) * 0.125f;
  Lanes e = splat(0.000938788289f);
  e = fma(e, y, splat(0.00918861199f));
  e = fma(e, y, splat(0.0552797243f));
  e = fma(e, y, splat(0.240172192f));
  e = fma(e, y, splat(0.693142235f));
  e = fma(e, y, splat(0.99999994f));
  e = e * e;
  e = e * e;
  return e * e;
}

}  // namespace goc::GOC_ISA
