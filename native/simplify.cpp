#include "simplify.hpp"

#include <cmath>
#include <queue>
#include <utility>

#include "quadric.hpp"

namespace goc {
namespace {

using namespace simplification;

constexpr double kRound = 1e-4;    // of the squared edge: what a collapse costs where the surface is flat
constexpr double kTurn = 0.4;      // least cosine between the normals of a face before and after
constexpr double kFlipTurn = 0.9;  // the same where an edge is flipped
constexpr double kNeedle = 0.35;   // an edge shorter than this part of its face's longest gives way even across groups
constexpr double kNear = 0.1;      // of the squared tolerance: a point this near to a face need not look for a nearer one
constexpr int kRepairs = 6;

class Simplifier {
 public:
  Simplifier(const Surface& mesh, const SimplifyLimits& limits) : limits_(limits), square_(limits.tolerance * limits.tolerance) {
    read(mesh);
    for (const Corners& face : faces_) add_quadrics(face);
  }

  void run() {
    collapse_all();
    for (int round = 0; round < kRepairs; ++round) {
      const bool flipped = flip_all(), merged = merge_slivers(), moved = move_all();
      if (!flipped && !merged && !moved) break;
    }
  }

  Surface result() const;

 private:
  void read(const Surface& mesh);
  void add_quadrics(const Corners& face);
  bool alive(std::int32_t face) const { return faces_[face][0] >= 0; }
  Vec place(std::int32_t vertex) const { return vertices_[vertex].place; }
  Vec normal(const Corners& f) const { return cross(place(f[1]) - place(f[0]), place(f[2]) - place(f[0])); }
  double quality_of(const Corners& f) const { return quality(place(f[0]), place(f[1]), place(f[2])); }

  void collapse_all();
  void push(std::int32_t from, std::int32_t to);
  void push_round(std::int32_t vertex);
  double cost_of(std::int32_t from, std::int32_t to, Vec& best) const;
  bool linked_once(std::int32_t from, std::int32_t to);
  bool collapse(std::int32_t from, std::int32_t to, Vec best);
  bool collapse_to(std::int32_t from, std::int32_t to, Vec goal);
  bool merge_slivers();
  bool flip_all();
  bool flip(std::int32_t first, int edge);
  bool move_all();

  // The change at hand: faces that go, each with its successor among those that come (-1: none), and the points told over.
  void begin() { gone_.clear(), come_.clear(), successor_.clear(); }
  bool shapes_hold(double least) const;
  bool points_hold();
  void hand_over(const std::vector<std::int32_t>& heirs);

  SimplifyLimits limits_;
  double square_;
  std::vector<Vertex> vertices_;
  std::vector<Corners> faces_;
  std::size_t count_ = 0;
  std::vector<Vec> points_;                // the original's vertices
  std::vector<std::int32_t> first_, next_;  // of each face's points; next of each point
  std::priority_queue<Candidate> queue_;
  std::vector<std::int32_t> gone_, successor_;
  std::vector<std::array<Vec, 3>> come_;
  std::vector<std::int32_t> told_, heir_;  // points of the change, and which of `come_` each goes to
  std::vector<std::uint32_t> mark_;
  std::uint32_t round_ = 0;
};

void Simplifier::read(const Surface& mesh) {
  const std::size_t count = mesh.groups.size();
  count_ = mesh.faces.size() / 3;
  vertices_.resize(count), points_.resize(count + count_), mark_.assign(count, 0), next_.assign(count + count_, -1);
  for (std::size_t v = 0; v < count; ++v) {
    const float *at = &mesh.vertices[3 * v], *value = &mesh.values[3 * v];
    vertices_[v].place = points_[v] = {at[0], at[1], at[2]};
    vertices_[v].value = {value[0], value[1], value[2]};
    vertices_[v].group = mesh.groups[v];
  }
  faces_.resize(count_), first_.assign(count_, -1);
  for (std::size_t face = 0; face < count_; ++face) {
    const auto middle = static_cast<std::int32_t>(count + face);
    first_[face] = middle;
    for (int corner = 0; corner < 3; ++corner) {
      const std::int32_t vertex = faces_[face][corner] = mesh.faces[3 * face + corner];
      points_[middle] = points_[middle] + vertices_[vertex].place * (1.0 / 3.0);
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
    vertex.error.add_plane(unit, -dot(unit, vertex.place), weight);
    vertex.area += weight;
  }
  for (int corner = 0; corner < 3; ++corner) {
    Vertex &a = vertices_[face[corner]], &b = vertices_[face[(corner + 1) % 3]];
    if (a.group != b.group || vertices_[face[(corner + 2) % 3]].group == a.group) continue;
    const Vec along = b.place - a.place, side = cross(along, unit);  // an edge of the line between groups
    const double wide = length(side);
    if (!(wide > 0.0)) continue;
    const Vec wall = side * (1.0 / wide);
    for (Vertex* end : {&a, &b}) end->error.add_plane(wall, -dot(wall, end->place), wide * wide / 2.0);
  }
}

double Simplifier::cost_of(std::int32_t from, std::int32_t to, Vec& best) const {
  const Vertex &a = vertices_[from], &b = vertices_[to];
  Quadric sum = a.error;
  sum.add(b.error);
  const Vec edge = b.place - a.place, step = b.value - a.value;
  best = sum.lowest((a.place + b.place) * 0.5, kRound * (a.area + b.area));
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
      std::array<Vec, 3> corners;
      for (int c = 0; c < 3; ++c) corners[c] = f[c] == moved ? goal : place(f[c]);
      const Vec old = normal(f), now = cross(corners[1] - corners[0], corners[2] - corners[0]);
      if (!(dot(old, now) > kTurn * length(old) * length(now))) return false;
      come_.push_back(corners), heirs.push_back(face);
    }
  if (!shapes_hold(std::min(limits_.quality, worst)) || !points_hold()) return false;
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
    }
  hand_over(heirs);
  const double share = a.area / std::max(a.area + b.area, 1e-300);
  b.place = goal, b.value = a.value * share + b.value * (1.0 - share);
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

void Simplifier::hand_over(const std::vector<std::int32_t>& heirs) {
  for (const std::int32_t face : gone_) first_[face] = -1;
  for (std::size_t i = 0; i < told_.size(); ++i) {
    const std::int32_t face = heirs[heir_[i]];
    next_[told_[i]] = first_[face], first_[face] = told_[i];
  }
}

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
  if (!points_hold()) return false;
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
    const Vec step = middle - v.place;
    const Vec goal = v.place + step - up * (dot(step, up) / std::max(dot(up, up), 1e-300));
    begin();
    bool turned = false;
    for (const std::int32_t face : v.faces) {
      std::array<Vec, 3> corners;
      for (int c = 0; c < 3; ++c) corners[c] = faces_[face][c] == static_cast<std::int32_t>(vertex) ? goal : place(faces_[face][c]);
      const Vec old = normal(faces_[face]), now = cross(corners[1] - corners[0], corners[2] - corners[0]);
      turned |= !(dot(old, now) > kTurn * length(old) * length(now));
      successor_.push_back(static_cast<std::int32_t>(gone_.size())), gone_.push_back(face), come_.push_back(corners);
    }
    if (turned || !shapes_hold(1.01 * worst) || !points_hold()) continue;
    const std::vector<std::int32_t> heirs = gone_;
    hand_over(heirs);
    v.place = goal, changed = true;
  }
  return changed;
}

Surface Simplifier::result() const {
  Surface out;
  std::vector<std::int32_t> name(vertices_.size(), -1);
  for (std::size_t v = 0; v < vertices_.size(); ++v) {
    const Vertex& vertex = vertices_[v];
    if (vertex.faces.empty()) continue;
    name[v] = static_cast<std::int32_t>(out.groups.size());
    out.groups.push_back(vertex.group);
    for (const double x : {vertex.place.x, vertex.place.y, vertex.place.z}) out.vertices.push_back(static_cast<float>(x));
    for (const double x : {vertex.value.x, vertex.value.y, vertex.value.z}) out.values.push_back(static_cast<float>(x));
  }
  for (const Corners& face : faces_) {
    if (face[0] < 0) continue;
    for (const std::int32_t corner : face) out.faces.push_back(name[corner]);
  }
  return out;
}

}  // namespace

Surface simplify(Surface mesh, const SimplifyLimits& limits) {
  Simplifier simplifier(mesh, limits);
  simplifier.run();
  return simplifier.result();
}

}  // namespace goc
