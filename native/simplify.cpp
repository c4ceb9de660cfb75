#include "simplifier.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace goc {
namespace simplification {
namespace {

constexpr double kRound = 1e-4;    // of the squared edge: what a collapse costs where the surface is flat
constexpr double kNear = 0.1;      // of the squared tolerance: a point this near to a face need not look for a nearer one

}  // namespace

void Simplifier::read(const Surface& mesh) {
  const std::size_t count = mesh.groups.size();
  count_ = mesh.faces.size() / 3;
  vertices_.resize(count), places_.resize(count), points_.resize(count + count_), mark_.assign(count, 0), next_.assign(count + count_, -1);
  for (std::size_t v = 0; v < count; ++v) {
    const float *at = &mesh.vertices[3 * v], *value = &mesh.values[3 * v];
    places_[v] = points_[v] = {at[0], at[1], at[2]};
    vertices_[v].value = {value[0], value[1], value[2]};
    vertices_[v].group = mesh.groups[v];
  }
  faces_.resize(count_), first_.assign(count_, -1);
  for (std::size_t face = 0; face < count_; ++face) {
    const auto middle = static_cast<std::int32_t>(count + face);
    first_[face] = middle;
    for (int corner = 0; corner < 3; ++corner) {
      const std::int32_t vertex = faces_[face][corner] = mesh.faces[3 * face + corner];
      points_[middle] = points_[middle] + place(vertex) * (1.0 / 3.0);
      if (vertices_[vertex].faces.empty()) next_[vertex] = first_[face], first_[face] = vertex;
      vertices_[vertex].faces.push_back(static_cast<std::int32_t>(face));
    }
  }
}

void Simplifier::add_quadrics(const Corners& face) {
  const Vec across = normal(face);
  const double doubled = length(across);
  if (!(doubled > 0.0)) return;
  const Vec unit = across * (1.0 / doubled);
  const double weight = doubled / 6.0;
  for (int corner = 0; corner < 3; ++corner) {
    Vertex& vertex = vertices_[face[corner]];
    vertex.error.add_plane(unit, -dot(unit, place(face[corner])), weight);
    vertex.area += weight;
  }
  for (int corner = 0; corner < 3; ++corner) {
    Vertex &a = vertices_[face[corner]], &b = vertices_[face[(corner + 1) % 3]];
    if (a.group != b.group || vertices_[face[(corner + 2) % 3]].group == a.group) continue;
    const Vec along = place(face[(corner + 1) % 3]) - place(face[corner]), side = cross(along, unit);  // an edge of the line between groups
    const double wide = length(side);
    if (!(wide > 0.0)) continue;
    const Vec wall = side * (1.0 / wide);
    for (Vertex* end : {&a, &b}) end->error.add_plane(wall, -dot(wall, place(face[corner])), wide * wide / 2.0);
  }
}

double Simplifier::cost_of(std::int32_t from, std::int32_t to, Vec& best) const {
  const Vertex &a = vertices_[from], &b = vertices_[to];
  Quadric sum = a.error;
  sum.add(b.error);
  const Vec edge = place(to) - place(from), step = b.value - a.value;
  best = sum.lowest((place(from) + place(to)) * 0.5, kRound * (a.area + b.area));
  return sum.at(best) + std::min(a.area, b.area) * (kRound * dot(edge, edge) + limits_.value * limits_.value * dot(step, step));
}

void Simplifier::push(std::int32_t from, std::int32_t to) {
  const Vertex &a = vertices_[from], &b = vertices_[to];
  if (a.group != b.group) return;
  Vec best;
  queue_.push({cost_of(from, to, best), from, to, a.stamp + b.stamp});  // stamps only grow: their sum tells
}

void Simplifier::push_round(std::int32_t vertex) {
  for (const std::int32_t face : vertices_[vertex].faces)
    for (int corner = 0; corner < 3; ++corner)
      if (faces_[face][corner] == vertex) push(vertex, faces_[face][(corner + 1) % 3]);
}

void Simplifier::collapse_all() {
  if (count_ <= limits_.faces) return;
  for (const Corners& face : faces_)
    for (int corner = 0; corner < 3; ++corner)
      if (face[corner] < face[(corner + 1) % 3]) push(face[corner], face[(corner + 1) % 3]);
  while (!queue_.empty() && count_ > limits_.faces) {
    const Candidate next = queue_.top();
    queue_.pop();
    const Vertex &a = vertices_[next.from], &b = vertices_[next.to];
    if (a.faces.empty() || b.faces.empty() || a.stamp + b.stamp != next.stamps) continue;
    Vec best;
    cost_of(next.from, next.to, best);
    if (collapse(next.from, next.to, best)) push_round(next.to);
  }
  queue_ = {};
}

// Two ends of an edge that share two neighbours and no more, each of which has others left: the surface stays a manifold.
bool Simplifier::linked_once(std::int32_t from, std::int32_t to) {
  ++round_;
  for (const std::int32_t face : vertices_[from].faces)
    for (const std::int32_t corner : faces_[face]) mark_[corner] = round_;
  int shared = 0;
  for (const std::int32_t face : vertices_[to].faces)
    for (int corner = 0; corner < 3; ++corner) {
      if (faces_[face][corner] != to) continue;
      const std::int32_t around = faces_[face][(corner + 1) % 3];
      if (around == from || mark_[around] != round_) continue;
      ++shared;
      if (vertices_[around].faces.size() <= 3) return false;
    }
  return shared == 2 && vertices_[from].faces.size() + vertices_[to].faces.size() > 6;
}

bool Simplifier::collapse(std::int32_t from, std::int32_t to, Vec best) {
  if (!linked_once(from, to)) return false;
  const Vec ends[2] = {place(from), place(to)};
  return collapse_to(from, to, best) || collapse_to(from, to, ends[1]) || collapse_to(from, to, ends[0]);
}

bool Simplifier::collapse_to(std::int32_t from, std::int32_t to, Vec goal) {
  goal = as_floats(goal);
  begin();
  std::vector<std::int32_t> heirs;
  double worst = 1.0;
  for (const std::int32_t moved : {from, to})
    for (const std::int32_t face : vertices_[moved].faces) {
      const Corners& f = faces_[face];
      bool both = true;
      for (const std::int32_t end : {from, to}) both &= f[0] == end || f[1] == end || f[2] == end;
      if (both && moved == to) continue;
      gone_.push_back(face), successor_.push_back(both ? -1 : static_cast<std::int32_t>(come_.size()));
      worst = std::min(worst, quality_of(f));
      if (both) continue;
      Triangle corners;
      for (int c = 0; c < 3; ++c) corners[c] = f[c] == moved ? goal : place(f[c]);
      const Vec old = normal(f), now = cross(corners[1] - corners[0], corners[2] - corners[0]);
      if (!(dot(old, now) > kTurn * length(old) * length(now))) return false;
      come_.push_back(corners), heirs.push_back(face);
    }
  if (!shapes_hold(std::min(limits_.quality, worst)) || !points_hold() || cuts_something()) return false;
  Vertex &a = vertices_[from], &b = vertices_[to];
  std::vector<std::int32_t> kept;
  for (const std::int32_t face : heirs)
    for (std::int32_t& corner : faces_[face]) {
      if (corner == from) corner = to;
      if (corner == to) kept.push_back(face);
    }
  for (const std::int32_t face : gone_)
    if (std::find(heirs.begin(), heirs.end(), face) == heirs.end()) {
      for (const std::int32_t corner : faces_[face]) {
        auto& around = vertices_[corner].faces;
        around.erase(std::remove(around.begin(), around.end(), face), around.end());
      }
      faces_[face] = {-1, -1, -1}, --count_;
      grid_->take(face);
    }
  hand_over(heirs);
  const double share = a.area / std::max(a.area + b.area, 1e-300);
  places_[to] = goal, b.value = a.value * share + b.value * (1.0 - share);
  b.error.add(a.error), b.area += a.area, b.stamp += a.stamp + 1;
  b.faces = std::move(kept), a.faces.clear();
  return true;
}

bool Simplifier::shapes_hold(double least) const {
  for (const auto& c : come_)
    if (!(quality(c[0], c[1], c[2]) >= least)) return false;
  return true;
}

// Whether each point of the faces that go is near one that comes; tells which.
bool Simplifier::points_hold() {
  told_.clear(), heir_.clear();
  for (std::size_t g = 0; g < gone_.size(); ++g)
    for (std::int32_t point = first_[gone_[g]]; point >= 0; point = next_[point]) {
      double nearest = INFINITY;
      std::int32_t heir = -1;
      const auto look = [&](std::int32_t face) {
        const double square = triangle_square(points_[point], come_[face][0], come_[face][1], come_[face][2]);
        if (square < nearest) nearest = square, heir = face;
      };
      if (successor_[g] >= 0) look(successor_[g]);
      for (std::size_t i = 0; i < come_.size() && nearest > kNear * square_; ++i) look(static_cast<std::int32_t>(i));
      if (!(nearest <= square_)) return false;
      told_.push_back(point), heir_.push_back(heir);
    }
  return true;
}

// Whether a face that comes cuts another of them, or one that stays. Those that come lie round one vertex or edge: where
// all of them look one way, none cuts another.
bool Simplifier::cuts_something() {
  FaceBox all;
  Vec up;
  boxes_.clear(), normals_.clear();
  for (const Triangle& face : come_) {
    boxes_.push_back(box_of(face)), normals_.push_back(across(face));
    all.add(boxes_.back()), up = up + normals_.back();
  }
  const bool level = std::all_of(normals_.begin(), normals_.end(), [&](Vec n) { return dot(n, up) > 0.0; });
  for (std::size_t i = 0; i < come_.size() && !level; ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (cut(come_[i], come_[j], normals_[j])) return true;
  bool found = false;
  grid_->visit(all, [&](std::int32_t face, const FaceBox& box) {
    if (found || std::find(gone_.begin(), gone_.end(), face) != gone_.end()) return;
    const Triangle other{place(faces_[face][0]), place(faces_[face][1]), place(faces_[face][2])};
    for (std::size_t i = 0; i < come_.size() && !found; ++i) found = box.meets(boxes_[i]) && cut(other, come_[i], normals_[i]);
  });
  return found;
}

void Simplifier::hand_over(const std::vector<std::int32_t>& heirs) {
  for (const std::int32_t face : gone_) first_[face] = -1;
  for (std::size_t i = 0; i < told_.size(); ++i) {
    const std::int32_t face = heirs[heir_[i]];
    next_[told_[i]] = first_[face], first_[face] = told_[i];
  }
  for (std::size_t i = 0; i < come_.size(); ++i) grid_->put(heirs[i], boxes_[i]);
}

Surface Simplifier::result() const {
  Surface out;
  std::vector<std::int32_t> name(vertices_.size(), -1);
  for (std::size_t v = 0; v < vertices_.size(); ++v) {
    const Vertex& vertex = vertices_[v];
    if (vertex.faces.empty()) continue;
    name[v] = static_cast<std::int32_t>(out.groups.size());
    out.groups.push_back(vertex.group);
    for (const double x : {places_[v].x, places_[v].y, places_[v].z}) out.vertices.push_back(static_cast<float>(x));
    for (const double x : {vertex.value.x, vertex.value.y, vertex.value.z}) out.values.push_back(static_cast<float>(x));
  }
  for (const Corners& face : faces_) {
    if (face[0] < 0) continue;
    for (const std::int32_t corner : face) out.faces.push_back(name[corner]);
  }
  return out;
}

}  // namespace simplification

Surface simplify(Surface mesh, const SimplifyLimits& limits) {
  simplification::Simplifier simplifier(mesh, limits);
  simplifier.run();
  return simplifier.result();
}

}  // namespace goc
