// A block of voxels against a depth image: sixteen voxels at a time, two rows of the block.
#include "../fuse.hpp"
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {
namespace {

// Where sixteen voxels are: pixel coordinates, depth, and the pixel each is in.
struct Landed {
  Lanes u, v, z, inverse_z;
  Mask inside;
  IntLanes pixel;
};

GOC_INLINE Landed land(const FusedView& view, const Lanes* point) {
  Landed at;
  at.z = point[2];
  at.inverse_z = splat(1.0f) / at.z;
  at.u = fma(point[0] * at.inverse_z, view.lens.fx, splat(view.lens.cx));
  at.v = fma(point[1] * at.inverse_z, view.lens.fy, splat(view.lens.cy));
  at.inside = (at.z > splat(0.0f)) & (at.u >= 0.0f) & (at.v >= 0.0f) & (splat((float)view.lens.width) > at.u) &
              (splat((float)view.lens.height) > at.v);
  at.pixel = truncate(keep(at.inside, at.v)) * view.lens.width + truncate(keep(at.inside, at.u));
  return at;
}

// Depth along the rays: bilinear where the four pixels round one are one surface, else the nearest's.
GOC_INLINE Lanes sample_depth(const FusedView& view, const Landed& at, Mask wanted, Lanes nearest) {
  const Lanes u = at.u - 0.5f, v = at.v - 0.5f;
  const Mask whole = wanted & (u >= 0.0f) & (v >= 0.0f) & (splat((float)(view.lens.width - 1)) > u) &
                     (splat((float)(view.lens.height - 1)) > v);
  const IntLanes x = truncate(keep(whole, u)), y = truncate(keep(whole, v)), first = y * view.lens.width + x;
  const Lanes none = splat(__builtin_nanf(""));
  const Lanes a = gather(view.depth, first, whole, none), b = gather(view.depth + 1, first, whole, none);
  const float* below = view.depth + view.lens.width;
  const Lanes c = gather(below, first, whole, none), d = gather(below + 1, first, whole, none);
  // NaN in any of the four is NaN in their sum, which agrees with nothing.
  const Lanes spread = max(max(a, b), max(c, d)) - min(min(a, b), min(c, d)) + ((a + b) + (c + d)) * 0.0f;
  Mask one = whole & (spread <= 2.0f * view.truncation);
  if (view.ids) {
    // The pixel itself is one of the four: all four alike means all like it.
    const IntLanes above = gather_pair(view.ids, first, whole);
    one = one & (above == gather_pair(view.ids + view.lens.width, first, whole)) & ((above << 16) >> 16 == above >> 16);
  }
  const Lanes s = u - to_float(x), t = v - to_float(y);
  const Lanes upper = fma(s, b, (1.0f - s) * a), lower = fma(s, d, (1.0f - s) * c);
  return select(one, fma(t, lower, (1.0f - t) * upper), nearest);
}

GOC_INLINE void add(float* sum, Lanes x) { store(sum, load(sum) + x); }

// The votes of voxels that lie near what was measured; sums of plane s are at sums + s·stride.
GOC_INLINE void vote(const FusedView& view, const Landed& at, Mask seen, Lanes nearest, Lanes slope, float* sums,
                     std::size_t stride) {
  const Lanes gap = sample_depth(view, at, seen, nearest) - at.z, weight = slope * at.inverse_z * at.inverse_z;
  // The distance to the tangent plane, not along the ray: views from all sides then mean the same thing.
  const Lanes distance = gap * slope;
  Mask own = seen, other = seen;
  if (view.ids) {
    const IntLanes ids = gather_short(view.ids, at.pixel, seen);
    own = own & (ids == view.wanted);
    other = (other & (ids >= 0)) & ~own;
  }
  const Mask passed = (distance > splat(0.5f * view.voxel)) & seen & (~own | (gap > splat(view.truncation)));
  if (bits(passed)) add(sums + kEmpty * stride, keep(passed, weight));
  // Written so that NaN counts: a pixel with a slope but no depth makes what it looks through unknown.
  const Mask band = ~((splat(-view.truncation) > distance) | (distance > splat(view.truncation)));
  // Behind the surface trust fades: what is there may be the far side of something thin.
  const Lanes faded = weight * min((distance + view.truncation) * view.fade, splat(1.0f));
  other = other & band, own = own & band;
  if (view.ids && bits(other)) add(sums + kOther * stride, keep(other, faded));
  if (!bits(own)) return;
  const Lanes trust = keep(own, faded);
  add(sums + kDistance * stride, keep(own, faded * distance));
  add(sums + kWeight * stride, trust);
  add(sums + kViews * stride, keep(own, splat(1.0f)));
  if (!view.colours) return;
  const IntLanes rgb = gather_rgb(view.colours, at.pixel, own);
  add(sums + kRed * stride, trust * to_float(rgb & 255));
  add(sums + kGreen * stride, trust * to_float((rgb >> 8) & 255));
  add(sums + kBlue * stride, trust * to_float(rgb >> 16));
}

}  // namespace

void fuse_block(const FusedView& view, const float* first, bool passed, float* sums, std::size_t stride) {
  Lanes offset[3];
  const Lanes along = load(kIota), row = keep(along >= (float)kBlockEdge, splat(1.0f)), none = splat(__builtin_nanf(""));
  for (int axis = 0; axis < 3; ++axis)
    offset[axis] = fma(along - row * (float)kBlockEdge, view.step[2][axis], row * view.step[1][axis] + first[axis]);
  for (int i = 0; i < kBlockEdge; ++i)
    for (int j = 0; j < kBlockEdge; j += 2, sums += 16) {
      Lanes point[3];
      for (int axis = 0; axis < 3; ++axis)
        point[axis] = offset[axis] + ((float)i * view.step[0][axis] + (float)j * view.step[1][axis]);
      const Landed at = land(view, point);
      if (!bits(at.inside)) continue;
      Mask seen = at.inside, open = at.inside;
      Lanes nearest, slope;
      if (passed) {
        slope = gather(view.slope, at.pixel, seen, none);
        open = slope == slope;
      } else {
        nearest = gather(view.depth, at.pixel, seen, none);
        // Further behind along the ray, an oblique tangent plane would speak for places that its surface never gets to.
        seen = at.inside & ~(at.z - nearest > splat(2.0f * view.truncation));
        if (!bits(seen)) continue;
        slope = gather(view.slope, at.pixel, seen, none);
        seen = seen & (slope == slope);
        // Neighbours that are one surface with the nearest pixel differ from it by no more than this.
        open = (nearest - at.z - 2.0f * view.truncation) * slope > splat(view.clear);
      }
      if (!passed && bits(seen & ~open)) {
        vote(view, at, seen, nearest, slope, sums, stride);
      } else if (bits(open)) {
        add(sums + kEmpty * stride, keep(open, slope * at.inverse_z * at.inverse_z));
      }
    }
}

}  // namespace goc::GOC_ISA
