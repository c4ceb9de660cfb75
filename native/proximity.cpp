// What lies near a triangle soup, and which of its triangles cut each other.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "raycast.hpp"
#include "triangle.hpp"

namespace goc {
namespace {

// Rounding of plane distances and places on a line, relative to the lengths they are made of. Corners are floats:
// anything real is larger by far.
constexpr double kTouch = 1e-10;

Vec corner(const std::array<float, 9>& t, int i) { return {t[3 * i], t[3 * i + 1], t[3 * i + 2]}; }

struct Interval {
  double low = INFINITY, high = -INFINITY;
  void add(double x) { low = std::min(low, x), high = std::max(high, x); }
};

// Signed heights of a triangle's corners over a plane; whether they lie strictly on both sides of it.
bool straddles(const Vec (&corners)[3], Vec origin, Vec normal, double (&heights)[3]) {
  const double unit = length(normal);
  bool above = false, below = false;
  for (int i = 0; i < 3; ++i) {
    const Vec arm = corners[i] - origin;
    heights[i] = dot(arm, normal);
    if (std::abs(heights[i]) <= kTouch * unit * length(arm)) heights[i] = 0.0;
    above |= heights[i] > 0.0, below |= heights[i] < 0.0;
  }
  return above && below;
}

// Where the triangle meets the plane its heights are measured from, along one axis.
Interval meeting(const Vec (&corners)[3], const double (&heights)[3], double Vec::*axis) {
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

// Möller (1997): each triangle reaches to both sides of the other's plane, and their pieces of the line in which the
// planes meet overlap.
bool cut(const std::array<float, 9>& first, const std::array<float, 9>& second) {
  Vec a[3], b[3];
  for (int i = 0; i < 3; ++i) a[i] = corner(first, i), b[i] = corner(second, i);
  const Vec normal_a = cross(a[1] - a[0], a[2] - a[0]), normal_b = cross(b[1] - b[0], b[2] - b[0]);
  double over_a[3], over_b[3];
  if (!straddles(a, b[0], normal_b, over_b) || !straddles(b, a[0], normal_a, over_a)) return false;
  const Vec line = cross(normal_a, normal_b);
  double Vec::*axis = std::abs(line.x) > std::abs(line.y) ? &Vec::x : &Vec::y;
  if (std::abs(line.z) > std::abs(line.*axis)) axis = &Vec::z;
  const Interval in_a = meeting(a, over_b, axis), in_b = meeting(b, over_a, axis);
  const double longest = std::max(in_a.high - in_a.low, in_b.high - in_b.low);
  return std::min(in_a.high, in_b.high) - std::max(in_a.low, in_b.low) > kTouch * longest;
}

}  // namespace

Nearest TriangleBvh::nearest(const double point[3], double limit) const {
  struct Entry {
    double square;
    std::uint32_t first, count;
  };
  const Vec p{point[0], point[1], point[2]};
  Nearest best;
  double best_square = limit * limit;
  std::vector<Entry> stack{{0.0, 0, 0}};
  while (!stack.empty()) {
    const Entry entry = stack.back();
    stack.pop_back();
    if (entry.square > best_square) continue;
    for (std::uint32_t place = entry.first; place < entry.first + entry.count; ++place) {
      const double square = triangle_square(p, corner(corners_[place], 0), corner(corners_[place], 1), corner(corners_[place], 2));
      const std::int32_t triangle = order_[place];
      if (square > best_square || (square == best_square && best.triangle >= 0 && triangle > best.triangle)) continue;
      best_square = square;
      best.triangle = triangle;
    }
    if (entry.count > 0) continue;
    const Node& node = nodes_[entry.first];
    const std::size_t base = stack.size();
    for (int child = 0; child < 4; ++child) {
      if (node.count[child] == 0 && node.first[child] == 0) continue;
      double square = 0.0;
      for (int axis = 0; axis < 3; ++axis) {
        const double off = std::max({node.low[axis][child] - point[axis], point[axis] - node.high[axis][child], 0.0});
        square += off * off;
      }
      if (square > best_square) continue;
      stack.push_back({square, node.first[child], node.count[child]});
      for (std::size_t i = stack.size() - 1; i > base && stack[i - 1].square < square; --i) {
        std::swap(stack[i - 1], stack[i]);  // the nearest on top
      }
    }
  }
  if (best.triangle >= 0) best.distance = std::sqrt(best_square);
  return best;
}

std::int32_t TriangleBvh::crossings(std::size_t place) const {
  const std::array<float, 9>& own = corners_[place];
  float low[3], high[3];
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = std::min({own[axis], own[3 + axis], own[6 + axis]});
    high[axis] = std::max({own[axis], own[3 + axis], own[6 + axis]});
  }
  std::int32_t found = 0;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> stack{{0, 0}};
  while (!stack.empty()) {
    const auto [first, count] = stack.back();
    stack.pop_back();
    for (std::uint32_t other = first; other < first + count; ++other) {
      if (other == place) continue;
      // In one order whichever of the two asks, so that both get the same answer.
      found += other < place ? cut(corners_[other], own) : cut(own, corners_[other]);
    }
    if (count > 0) continue;
    const Node& node = nodes_[first];
    for (int child = 0; child < 4; ++child) {
      if (node.count[child] == 0 && node.first[child] == 0) continue;
      bool apart = false;
      for (int axis = 0; axis < 3; ++axis) {
        apart |= node.low[axis][child] > high[axis] || node.high[axis][child] < low[axis];
      }
      if (!apart) stack.emplace_back(node.first[child], node.count[child]);
    }
  }
  return found;
}

}  // namespace goc
