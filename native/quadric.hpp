// What simplification keeps of vertices, and how it judges faces.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <tuple>
#include <vector>

#include "triangle.hpp"

namespace goc::simplification {

// Squared distances to planes, weighed by areas (Garland and Heckbert 1997).
struct Quadric {
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0, x = 0, y = 0, z = 0, one = 0;

  void add_plane(Vec n, double offset, double weight) {
    xx += weight * n.x * n.x, xy += weight * n.x * n.y, xz += weight * n.x * n.z;
    yy += weight * n.y * n.y, yz += weight * n.y * n.z, zz += weight * n.z * n.z;
    x += weight * n.x * offset, y += weight * n.y * offset, z += weight * n.z * offset, one += weight * offset * offset;
  }
  void add(const Quadric& o) {
    xx += o.xx, xy += o.xy, xz += o.xz, yy += o.yy, yz += o.yz, zz += o.zz, x += o.x, y += o.y, z += o.z, one += o.one;
  }
  double at(Vec p) const {
    const double square = p.x * (xx * p.x + 2 * (xy * p.y + xz * p.z + x)) + p.y * (yy * p.y + 2 * (yz * p.z + y)) +
                          p.z * (zz * p.z + 2 * z) + one;
    return std::max(square, 0.0);
  }
  // The place of least error, drawn towards `middle` by the weight given: there is always one.
  Vec lowest(Vec middle, double weight) const {
    const double a = xx + weight, b = yy + weight, c = zz + weight;
    const Vec r{weight * middle.x - x, weight * middle.y - y, weight * middle.z - z};
    const double aa = b * c - yz * yz, ab = xz * yz - xy * c, ac = xy * yz - xz * b;
    const double bb = a * c - xz * xz, bc = xy * xz - a * yz, cc = a * b - xy * xy;
    const double determinant = a * aa + xy * ab + xz * ac;
    if (!(determinant > 0.0)) return middle;
    return Vec{aa * r.x + ab * r.y + ac * r.z, ab * r.x + bb * r.y + bc * r.z, ac * r.x + bc * r.y + cc * r.z} *
           (1.0 / determinant);
  }
};

using Corners = std::array<std::int32_t, 3>;

struct Vertex {
  Vec value;
  Quadric error;
  double area = 0.0;
  std::uint32_t stamp = 0;
  std::uint8_t group = 0;
  std::vector<std::int32_t> faces;
};

struct Candidate {
  double cost;
  std::int32_t from, to;
  std::uint32_t stamps;
  bool operator<(const Candidate& o) const {  // the cheapest on top
    return std::tie(o.cost, o.from, o.to) < std::tie(cost, from, to);
  }
};

inline double quality(Vec a, Vec b, Vec c) {
  const Vec ab = b - a, bc = c - b, ca = a - c;
  const double edges = dot(ab, ab) + dot(bc, bc) + dot(ca, ca);
  return edges > 0.0 ? 2.0 * std::sqrt(3.0) * length(cross(ab, bc)) / edges : 0.0;
}

}  // namespace goc::simplification
