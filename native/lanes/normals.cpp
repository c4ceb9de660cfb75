// Planes through the pixels round each pixel of a depth image, sixteen pixels of a row at a time.
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {
namespace {

// Normal equations of q = a·u + b·v + c over the pixels near one: on a plane inverse depth is linear in the pixel.
struct PlaneFit {
  Lanes n, u, v, uu, uv, vv, q, uq, vq;
};

// q is relative to the pixel's own inverse depth, or the sums would drown the differences.
GOC_INLINE void add(PlaneFit& fit, Lanes z, Lanes other, float agree, float du, float dv) {
  const Lanes apart = other - z;
  const Mask near = z * agree >= max(apart, splat(0.0f) - apart);
  const Lanes one = keep(near, splat(1.0f)), value = keep(near, (z - other) / other);
  fit.n = fit.n + one, fit.u = fma(one, du, fit.u), fit.v = fma(one, dv, fit.v);
  fit.uu = fma(one, du * du, fit.uu), fit.uv = fma(one, du * dv, fit.uv), fit.vv = fma(one, dv * dv, fit.vv);
  fit.q = fit.q + value, fit.uq = fma(value, du, fit.uq), fit.vq = fma(value, dv, fit.vq);
}

}  // namespace

void plane_normal_row(const FitRow& row, float* const* normal) {
  const int side = 2 * row.radius + 1;
  for (int x = 0; x < row.width; x += 16) {
    const Lanes zero = splat(0.0f), z = load(row.depth[row.radius] + row.radius + x);
    PlaneFit fit{zero, zero, zero, zero, zero, zero, zero, zero, zero};
    for (int v = 0; v < side; ++v)
      for (int u = 0; u < side; ++u)
        add(fit, z, load(row.depth[v] + x + u), row.agree, (float)(u - row.radius), (float)(v - row.radius));
    const Lanes over = splat(1.0f) / fit.n;
    const Lanes suu = fit.uu - fit.u * fit.u * over, suv = fit.uv - fit.u * fit.v * over;
    const Lanes svv = fit.vv - fit.v * fit.v * over, suq = fit.uq - fit.u * fit.q * over;
    const Lanes svq = fit.vq - fit.v * fit.q * over, det = suu * svv - suv * suv;
    const Lanes a = (suq * svv - svq * suv) / det, b = (svq * suu - suq * suv) / det;
    const Lanes c = (fit.q - a * fit.u - b * fit.v) * over;
    // Pixels on one line have no plane.
    const Mask found = (z > zero) & (fit.n >= row.fewest) & (det >= fit.n * fit.n * 1e-3f);
    // z/depth = 1 + c + a·du + b·dv; in ray coordinates that is the plane's normal over its distance.
    const Lanes nx = a * row.fx, ny = b * row.fy;
    const Lanes nz = c + 1.0f - a * (load(kIota) + ((float)x + 0.5f - row.cx)) - b * row.from_centre;
    const Lanes scale = splat(-1.0f) / sqrt(nx * nx + ny * ny + nz * nz), none = splat(__builtin_nanf(""));
    store(normal[0] + x, select(found, nx * scale, none));
    store(normal[1] + x, select(found, ny * scale, none));
    store(normal[2] + x, select(found, nz * scale, none));
  }
}

}  // namespace goc::GOC_ISA
