// Vectors, and squared distances from a point to segments and triangles, in double.
#pragma once
#include <algorithm>
#include <cmath>

namespace goc {

struct Vec {
  double x = 0.0, y = 0.0, z = 0.0;
  Vec operator+(Vec o) const { return {x + o.x, y + o.y, z + o.z}; }
  Vec operator-(Vec o) const { return {x - o.x, y - o.y, z - o.z}; }
  Vec operator*(double s) const { return {x * s, y * s, z * s}; }
};

inline double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double length(Vec a) { return std::sqrt(dot(a, a)); }

inline double segment_square(Vec p, Vec a, Vec b) {
  const Vec along = b - a;
  const double square = dot(along, along);
  const double t = square > 0.0 ? std::clamp(dot(p - a, along) / square, 0.0, 1.0) : 0.0;
  const Vec off = p - (a + along * t);
  return dot(off, off);
}

// Squared distance to the face where the point is above it, else to the nearest of its edges.
inline double triangle_square(Vec p, Vec a, Vec b, Vec c) {
  const Vec normal = cross(b - a, c - a);
  const double square = dot(normal, normal);
  if (square > 0.0 && dot(cross(b - a, p - a), normal) >= 0.0 && dot(cross(c - b, p - b), normal) >= 0.0 &&
      dot(cross(a - c, p - c), normal) >= 0.0) {
    const double height = dot(p - a, normal);
    return height * height / square;
  }
  return std::min({segment_square(p, a, b), segment_square(p, b, c), segment_square(p, c, a)});
}

}  // namespace goc
