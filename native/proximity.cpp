// What lies near a triangle soup, and which of its triangles cut each other.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "crossing.hpp"
#include "raycast.hpp"

namespace goc {
namespace {

Vec corner(const std::array<float, 9>& t, int i) { return {t[3 * i], t[3 * i + 1], t[3 * i + 2]}; }

Triangle triangle(const std::array<float, 9>& t) { return {corner(t, 0), corner(t, 1), corner(t, 2)}; }

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
  const Triangle here = triangle(own);
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
      found += other < place ? cut(triangle(corners_[other]), here) : cut(here, triangle(corners_[other]));
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
