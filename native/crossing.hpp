// Whether two triangles cut each other: they share a segment of positive length and are not coplanar.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>

#include "triangle.hpp"

namespace goc {

using Triangle = std::array<Vec, 3>;

namespace crossing {

// Rounding of plane distances and places on a line, relative to the lengths they are made of. Corners are floats:
// anything real is larger by far.
constexpr double kTouch = 1e-10;

struct Interval {
  double low = INFINITY, high = -INFINITY;
  void add(double x) { low = std::min(low, x), high = std::max(high, x); }
};

// Signed heights of a triangle's corners over a plane; whether they lie strictly on both sides of it.
inline bool straddles(const Triangle& corners, Vec origin, Vec normal, double (&heights)[3]) {
  const double least = kTouch * kTouch * dot(normal, normal);
  bool above = false, below = false;
  for (int i = 0; i < 3; ++i) {
    const Vec arm = corners[i] - origin;
    heights[i] = dot(arm, normal);
    if (heights[i] * heights[i] <= least * dot(arm, arm)) heights[i] = 0.0;
    above |= heights[i] > 0.0, below |= heights[i] < 0.0;
  }
  return above && below;
}

// Where the triangle meets the plane its heights are measured from, along one axis.
inline Interval meeting(const Triangle& corners, const double (&heights)[3], double Vec::*axis) {
  Interval found;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    if (heights[i] == 0.0) found.add(corners[i].*axis);
    if (heights[i] * heights[j] < 0.0) {
      const double share = heights[i] / (heights[i] - heights[j]);
      found.add(corners[i].*axis + share * (corners[j].*axis - corners[i].*axis));
    }
  }
  return found;
}

}  // namespace crossing

// Möller (1997): each triangle reaches to both sides of the other's plane, and their pieces of the line in which the
// planes meet overlap. Triangles that merely touch, in a common edge or corner or else, do not cut each other.
inline Vec across(const Triangle& t) { return cross(t[1] - t[0], t[2] - t[0]); }

inline bool cut(const Triangle& a, const Triangle& b, Vec normal_b) {
  using namespace crossing;
  double over_a[3], over_b[3];
  if (!straddles(a, b[0], normal_b, over_b)) return false;
  const Vec normal_a = across(a);
  if (!straddles(b, a[0], normal_a, over_a)) return false;
  const Vec line = cross(normal_a, normal_b);
  double Vec::*axis = std::abs(line.x) > std::abs(line.y) ? &Vec::x : &Vec::y;
  if (std::abs(line.z) > std::abs(line.*axis)) axis = &Vec::z;
  const Interval in_a = meeting(a, over_b, axis), in_b = meeting(b, over_a, axis);
  const double longest = std::max(in_a.high - in_a.low, in_b.high - in_b.low);
  return std::min(in_a.high, in_b.high) - std::max(in_a.low, in_b.low) > kTouch * longest;
}
inline bool cut(const Triangle& a, const Triangle& b) { return cut(a, b, across(b)); }

}  // namespace goc
