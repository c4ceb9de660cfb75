// Powers and logarithms of lanes.
#pragma once
#include "simd.hpp"

namespace goc::GOC_ISA {

// 2^x for x in [-8, 0]; anything may come of a smaller x.
#if defined(__AVX2__)
// 2^(k/n)·2^f: rounding x to k/n leaves k in the low bits of a float, which pick 2^(j/n), j = k mod n, from a register.
// Its bits lack j << shift, so that adding k << shift leaves the exponent. Five of eight multiplications are saved.
#if defined(__AVX512F__)
constexpr float kRounding = 0x1.8p19f;  // n = 16; relative error 5e-7
constexpr int kShift = 19;
alignas(64) static const std::int32_t kPowers[16] = {
    0x3f800000, 0x3f7daac3, 0x3f7b95c2, 0x3f79c3d3, 0x3f7837f0, 0x3f76f532, 0x3f75fed7, 0x3f75583f,
    0x3f7504f3, 0x3f7508a4, 0x3f75672a, 0x3f76248c, 0x3f7744fd, 0x3f78ccdf, 0x3f7ac0c7, 0x3f7d257d};
GOC_INLINE IntPart power_of(IntPart k, IntPart powers) {
  return (IntPart)_mm512_maskz_permutexvar_epi32(0xffff, (__m512i)k, (__m512i)powers);
}
GOC_INLINE Lanes exp2_near_0(Lanes f) { return fma(fma(splat(0.240219463f), f, splat(0.693187832f)), f, splat(1.0f)); }
#else
constexpr float kRounding = 0x1.8p20f;  // n = 8; relative error 1e-7
constexpr int kShift = 20;
alignas(32) static const std::int32_t kPowers[8] = {
    0x3f800000, 0x3f7b95c2, 0x3f7837f0, 0x3f75fed7, 0x3f7504f3, 0x3f75672a, 0x3f7744fd, 0x3f7ac0c7};
GOC_INLINE IntPart power_of(IntPart k, IntPart powers) {
  return (IntPart)_mm256_permutevar8x32_epi32((__m256i)powers, (__m256i)k);
}
GOC_INLINE Lanes exp2_near_0(Lanes f) {
  return fma(fma(fma(splat(0.0554989005f), f, splat(0.240264073f)), f, splat(0.693147209f)), f, splat(1.0f));
}
#endif
GOC_INLINE Lanes exp2_above_minus_8(Lanes x) {
  IntPart powers;
  __builtin_memcpy(&powers, kPowers, sizeof powers);
  const Lanes rounded = x + kRounding;
  const Lanes e = exp2_near_0(x - (rounded - kRounding));
  Lanes power;
  GOC_EACH(const IntPart k = bits_of(rounded.part[p]); power.part[p] = part_of(power_of(k, powers) + (k << kShift)))
  return e * power;
}
#else
// A polynomial of 2^(x/8), squared three times: relative error 3e-6.
GOC_INLINE Lanes exp2_above_minus_8(Lanes x) {
  Lanes e = splat(2.86495449e-08f);
  e = fma(e, x, splat(2.24331345e-06f));
  e = fma(e, x, splat(0.000107968211f));
  e = fma(e, x, splat(0.0037526905f));
  e = fma(e, x, splat(0.0866427794f));
  e = fma(e, x, splat(0.99999994f));
  e = e * e;
  e = e * e;
  return e * e;
}
#endif

// 2^x, relative error 2e-7; x counts as within [-126, 126].
GOC_INLINE Lanes exp2(Lanes x) {
  x = max(min(x, splat(126.0f)), splat(-126.0f));
  Lanes power;
  GOC_EACH(const IntPart whole = __builtin_convertvector(x.part[p] + (x.part[p] < 0.0f ? Part{} - 0.5f : Part{} + 0.5f), IntPart);
           x.part[p] -= __builtin_convertvector(whole, Part); power.part[p] = part_of((whole + 127) << 23);)
  Lanes e = splat(1.5403530e-04f);
  e = fma(e, x, splat(1.3333558e-03f));
  e = fma(e, x, splat(9.6181291e-03f));
  e = fma(e, x, splat(5.5504109e-02f));
  e = fma(e, x, splat(2.4022651e-01f));
  e = fma(e, x, splat(6.9314718e-01f));
  return fma(e, x, splat(1.0f)) * power;
}

// log2 of a positive, normal x: the exponent, and the series of artanh for a mantissa in [√½, √2).
GOC_INLINE Lanes log2(Lanes x) {
  Lanes exponent;
  GOC_EACH(const IntPart shifted = bits_of(x.part[p]) - 0x3f3504f3; const IntPart whole = shifted >> 23;
           exponent.part[p] = __builtin_convertvector(whole, Part);
           x.part[p] = part_of((shifted & 0x7fffff) + 0x3f3504f3);)
  const Lanes s = (x - 1.0f) / (x + 1.0f), s2 = s * s;
  Lanes series = splat(0.32059890f);
  series = fma(series, s2, splat(0.41219859f));
  series = fma(series, s2, splat(0.57707802f));
  series = fma(series, s2, splat(0.96179669f));
  series = fma(series, s2, splat(2.8853901f));
  return fma(series, s, exponent);
}

}  // namespace goc::GOC_ISA
