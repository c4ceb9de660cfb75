// Faces of bad shape: edges flipped, slivers merged, vertices moved along the surface.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "simplifier.hpp"

namespace goc::simplification {
namespace {

constexpr double kFlipTurn = 0.9;  // the same where an edge is flipped
constexpr double kNeedle = 0.35;   // an edge shorter than this part of its face's longest gives way even across groups

}  // namespace

// A face out of shape gives up its shortest edge.
bool Simplifier::merge_slivers() {
  bool changed = false;
  for (std::size_t face = 0; face < faces_.size(); ++face) {
    if (!alive(face) || quality_of(faces_[face]) >= limits_.quality) continue;
    const Corners f = faces_[face];
    std::array<std::pair<double, int>, 3> edges;
    for (int c = 0; c < 3; ++c) {
      const Vec edge = place(f[(c + 1) % 3]) - place(f[c]);
      edges[c] = {dot(edge, edge), c};
    }
    std::sort(edges.begin(), edges.end());
    for (const auto& [square, c] : {edges[0], edges[1]}) {
      std::int32_t from = f[c], to = f[(c + 1) % 3];
      if (vertices_[from].group != vertices_[to].group) {
        if (square > kNeedle * kNeedle * edges[2].first) continue;
        if (vertices_[from].area > vertices_[to].area) std::swap(from, to);
      }
      Vec best;
      cost_of(from, to, best);
      if (!collapse(from, to, best)) continue;
      changed = true;
      break;
    }
  }
  return changed;
}

bool Simplifier::flip_all() {
  bool changed = false;
  for (std::size_t face = 0; face < faces_.size(); ++face)
    for (int edge = 0; edge < 3 && alive(face); ++edge) changed |= flip(face, edge);
  return changed;
}

// The other diagonal of two faces, where that makes the worse of them better.
bool Simplifier::flip(std::int32_t first, int edge) {
  const Corners f = faces_[first];
  const std::int32_t a = f[edge], b = f[(edge + 1) % 3], c = f[(edge + 2) % 3];
  std::int32_t second = -1, d = -1;
  for (const std::int32_t face : vertices_[a].faces)
    for (int corner = 0; corner < 3; ++corner)
      if (faces_[face][corner] == b && faces_[face][(corner + 1) % 3] == a) second = face, d = faces_[face][(corner + 2) % 3];
  if (second < 0 || c == d || vertices_[a].faces.size() <= 3 || vertices_[b].faces.size() <= 3) return false;
  const double before = std::min(quality_of(f), quality_of(faces_[second]));
  const Corners left{a, d, c}, right{d, b, c};
  if (!(std::min(quality_of(left), quality_of(right)) > 1.01 * before)) return false;
  for (const std::int32_t face : vertices_[c].faces)
    for (const std::int32_t corner : faces_[face])
      if (corner == d) return false;  // already joined
  const Vec old[2] = {normal(f), normal(faces_[second])}, now[2] = {normal(left), normal(right)};
  for (const Vec& o : old)
    for (const Vec& n : now)
      if (!(dot(o, n) >= kFlipTurn * length(o) * length(n)) && length(o) > 0.0) return false;
  begin();
  gone_ = {first, second}, successor_ = {0, 1};
  for (const Corners& face : {left, right}) come_.push_back({place(face[0]), place(face[1]), place(face[2])});
  if (!points_hold() || cuts_something()) return false;
  faces_[first] = left, faces_[second] = right;
  hand_over({first, second});
  auto drop = [&](std::int32_t vertex, std::int32_t face) {
    auto& around = vertices_[vertex].faces;
    around.erase(std::remove(around.begin(), around.end(), face), around.end());
  };
  drop(b, first), drop(a, second);
  vertices_[c].faces.push_back(second), vertices_[d].faces.push_back(first);
  return true;
}

// A vertex of a face out of shape goes towards the middle of its neighbours, along the surface.
bool Simplifier::move_all() {
  bool changed = false;
  for (std::size_t vertex = 0; vertex < vertices_.size(); ++vertex) {
    Vertex& v = vertices_[vertex];
    double worst = 1.0;
    Vec middle, up;
    bool border = false;
    for (const std::int32_t face : v.faces) {
      worst = std::min(worst, quality_of(faces_[face]));
      up = up + normal(faces_[face]);
      for (const std::int32_t corner : faces_[face]) {
        middle = middle + place(corner) * (1.0 / 3.0 / v.faces.size());
        border |= vertices_[corner].group != v.group;
      }
    }
    if (v.faces.empty() || border || worst >= limits_.quality) continue;
    const Vec step = middle - place(static_cast<std::int32_t>(vertex));
    const Vec goal = as_floats(places_[vertex] + step - up * (dot(step, up) / std::max(dot(up, up), 1e-300)));
    begin();
    bool turned = false;
    for (const std::int32_t face : v.faces) {
      Triangle corners;
      for (int c = 0; c < 3; ++c) corners[c] = faces_[face][c] == static_cast<std::int32_t>(vertex) ? goal : place(faces_[face][c]);
      const Vec old = normal(faces_[face]), now = cross(corners[1] - corners[0], corners[2] - corners[0]);
      turned |= !(dot(old, now) > kTurn * length(old) * length(now));
      successor_.push_back(static_cast<std::int32_t>(gone_.size())), gone_.push_back(face), come_.push_back(corners);
    }
    if (turned || !shapes_hold(1.01 * worst) || !points_hold() || cuts_something()) continue;
    const std::vector<std::int32_t> heirs = gone_;
    hand_over(heirs);
    places_[vertex] = goal, changed = true;
  }
  return changed;
}

}  // namespace goc::simplification
