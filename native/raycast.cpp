// Four-wide binned-SAH hierarchy (Wald 2007) and the watertight ray-triangle test of Woop, Benthin and Wald (2013), in
// double precision; boxes are tested in single precision, widened by the rounding error. CMakeLists.txt compiles this
// file without floating-point contraction: two triangles that share an edge must compute the same edge function up to
// its sign, or a ray could slip between them.
#include "raycast.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace goc {
namespace {

constexpr std::uint32_t kLeafSize = 4;
constexpr int kBins = 16;
// Below this depth nodes are halved by count, which bounds the depth, and with it the stack of a traversal.
constexpr int kMaxSahDepth = 56;
constexpr int kStackSize = 3 * (kMaxSahDepth + 32) / 2 + 4;

// GCC and clang map this to SSE and NEON alike.
typedef float Float4 __attribute__((vector_size(16)));

Float4 splat(float x) { return Float4{x, x, x, x}; }
Float4 min4(Float4 a, Float4 b) { return a < b ? a : b; }
Float4 max4(Float4 a, Float4 b) { return a > b ? a : b; }
Float4 load4(const float* x) { return Float4{x[0], x[1], x[2], x[3]}; }

struct Box {
  std::array<float, 3> low{INFINITY, INFINITY, INFINITY};
  std::array<float, 3> high{-INFINITY, -INFINITY, -INFINITY};

  void add(const float* point) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], point[axis]);
      high[axis] = std::max(high[axis], point[axis]);
    }
  }
  void add(const Box& other) {
    if (other.low[0] > other.high[0]) return;
    add(other.low.data());
    add(other.high.data());
  }
  double half_area() const {
    if (low[0] > high[0]) return 0.0;
    const double x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return x * y + y * z + z * x;
  }
};

// A ray in the sheared frame of the watertight test, with what the slab test needs.
struct Ray {
  double origin[3];
  int kx, ky, kz;
  double shear_x, shear_y, shear_z;
  Float4 start[3], inverse[3], slack[3];

  // `reach`: the largest absolute coordinate of the scene, for the rounding error of (plane - origin).
  Ray(const double* o, const double* d, float reach) {
    for (int axis = 0; axis < 3; ++axis) {
      origin[axis] = o[axis];
      start[axis] = splat(static_cast<float>(o[axis]));
      // A huge finite inverse instead of infinity: 0 · ∞ would be NaN for origins that lie on a slab.
      const float inv = std::abs(d[axis]) > 1e-30 ? static_cast<float>(1.0 / d[axis])
                                                  : std::copysign(1e30f, static_cast<float>(d[axis]));
      inverse[axis] = splat(inv);
      // Four roundings of at most 2^-24 each, doubled (Ize 2013 widens by the error likewise).
      slack[axis] = splat(0x1p-21f * (reach + std::abs(static_cast<float>(o[axis]))) * std::abs(inv));
    }
    kz = std::abs(d[0]) > std::abs(d[1]) ? 0 : 1;
    if (std::abs(d[2]) > std::abs(d[kz])) kz = 2;
    kx = (kz + 1) % 3;
    ky = (kx + 1) % 3;
    if (d[kz] < 0.0) std::swap(kx, ky);  // keeps the winding
    shear_x = d[kx] / d[kz];
    shear_y = d[ky] / d[kz];
    shear_z = 1.0 / d[kz];
  }

  // Entry distances into a node's four boxes; a box is hit where `entry <= exit`.
  void enter(const float (&low)[3][4], const float (&high)[3][4], float limit, Float4& entry, Float4& exit) const {
    entry = splat(0.0f);
    exit = splat(limit);
    for (int axis = 0; axis < 3; ++axis) {
      const Float4 a = (load4(low[axis]) - start[axis]) * inverse[axis];
      const Float4 b = (load4(high[axis]) - start[axis]) * inverse[axis];
      entry = max4(entry, min4(a, b) - slack[axis]);
      exit = min4(exit, max4(a, b) + slack[axis]);
    }
  }

  bool intersect(const std::array<float, 9>& corners, RayHit& hit) const {
    double x[3], y[3], z[3];
    for (int corner = 0; corner < 3; ++corner) {
      const float* p = corners.data() + 3 * corner;
      z[corner] = p[kz] - origin[kz];
      x[corner] = (p[kx] - origin[kx]) - shear_x * z[corner];
      y[corner] = (p[ky] - origin[ky]) - shear_y * z[corner];
    }
    const double u = x[2] * y[1] - y[2] * x[1];
    const double v = x[0] * y[2] - y[0] * x[2];
    const double w = x[1] * y[0] - y[1] * x[0];
    if ((u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0)) return false;
    const double area = u + v + w;
    if (area == 0.0) return false;  // seen edge on
    hit.u = u / area;
    hit.v = v / area;
    hit.w = w / area;
    hit.back = area < 0.0;
    hit.t = shear_z * (hit.u * z[0] + hit.v * z[1] + hit.w * z[2]);
    return hit.t > 0.0;
  }
};

}  // namespace

struct TriangleBvh::Builder {
  std::vector<Node>& nodes;
  std::vector<std::int32_t>& order;
  std::vector<Box> boxes;
  std::vector<std::array<float, 3>> centres;

  struct Range {
    std::uint32_t begin, end;
    std::uint32_t size() const { return end - begin; }
  };

  // Fills a node with up to four children: two binary splits, one after the other.
  void build(std::uint32_t node, Range range, int depth) {
    std::array<Range, 4> parts;
    int count = 0;
    for (const Range half : halves(range, depth)) {
      if (half.size() == 0) continue;
      if (half.size() <= kLeafSize) {
        parts[count++] = half;
        continue;
      }
      for (const Range quarter : halves(half, depth + 1)) parts[count++] = quarter;
    }
    for (int child = 0; child < 4; ++child) {
      const Range part = child < count ? parts[child] : Range{0, 0};
      const Box bounds = bounds_of(part);
      for (int axis = 0; axis < 3; ++axis) {
        nodes[node].low[axis][child] = bounds.low[axis];
        nodes[node].high[axis][child] = bounds.high[axis];
      }
      const bool leaf = part.size() <= kLeafSize;
      nodes[node].count[child] = leaf ? part.size() : 0;
      nodes[node].first[child] = leaf ? part.begin : static_cast<std::uint32_t>(nodes.size());
      if (leaf) continue;
      nodes.emplace_back();
      build(nodes[node].first[child], part, depth + 2);
    }
  }

  Box bounds_of(Range range) const {
    Box bounds;
    for (std::uint32_t i = range.begin; i < range.end; ++i) bounds.add(boxes[order[i]]);
    return bounds;
  }

  std::array<Range, 2> halves(Range range, int depth) {
    if (range.size() <= kLeafSize) return {range, Range{range.end, range.end}};
    Box centre_bounds;
    for (std::uint32_t i = range.begin; i < range.end; ++i) centre_bounds.add(centres[order[i]].data());
    const std::uint32_t middle = split(range.begin, range.end, centre_bounds, depth);
    return {Range{range.begin, middle}, Range{middle, range.end}};
  }

  std::uint32_t split(std::uint32_t begin, std::uint32_t end, const Box& centre_bounds, int depth) {
    int best_axis = -1, best_bin = 0;
    if (depth < kMaxSahDepth) choose(begin, end, centre_bounds, best_axis, best_bin);
    if (best_axis < 0) return begin + (end - begin) / 2;
    const auto middle = std::stable_partition(order.begin() + begin, order.begin() + end, [&](std::int32_t triangle) {
      return bin_of(triangle, best_axis, centre_bounds) <= best_bin;
    });
    return static_cast<std::uint32_t>(middle - order.begin());
  }

  int bin_of(std::int32_t triangle, int axis, const Box& centre_bounds) const {
    const double low = centre_bounds.low[axis], extent = centre_bounds.high[axis] - low;
    return std::min(kBins - 1, static_cast<int>(kBins * ((centres[triangle][axis] - low) / extent)));
  }

  // The plane with the least surface-area cost; leaves best_axis alone where all centres coincide.
  void choose(std::uint32_t begin, std::uint32_t end, const Box& centre_bounds, int& best_axis, int& best_bin) const {
    double best_cost = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      if (!(centre_bounds.high[axis] > centre_bounds.low[axis])) continue;
      std::array<Box, kBins> box;
      std::array<std::uint32_t, kBins> count{};
      for (std::uint32_t i = begin; i < end; ++i) {
        const int bin = bin_of(order[i], axis, centre_bounds);
        box[bin].add(boxes[order[i]]);
        ++count[bin];
      }
      std::array<double, kBins> right_cost{};
      Box right;
      std::uint32_t right_count = 0;
      for (int bin = kBins - 1; bin > 0; --bin) {
        right.add(box[bin]);
        right_count += count[bin];
        right_cost[bin] = right.half_area() * right_count;
      }
      Box left;
      std::uint32_t left_count = 0;
      for (int bin = 0; bin < kBins - 1; ++bin) {
        left.add(box[bin]);
        left_count += count[bin];
        if (left_count == 0 || left_count == end - begin) continue;
        const double cost = left.half_area() * left_count + right_cost[bin + 1];
        if (cost < best_cost) {
          best_cost = cost;
          best_axis = axis;
          best_bin = bin;
        }
      }
    }
  }
};

TriangleBvh::TriangleBvh(const float* vertices, const std::int32_t* faces, std::size_t face_count) {
  Builder builder{nodes_, order_, std::vector<Box>(face_count), std::vector<std::array<float, 3>>(face_count)};
  order_.resize(face_count);
  for (std::size_t triangle = 0; triangle < face_count; ++triangle) {
    Box& box = builder.boxes[triangle];
    for (int corner = 0; corner < 3; ++corner) box.add(vertices + 3 * std::size_t(faces[3 * triangle + corner]));
    for (int axis = 0; axis < 3; ++axis) {
      builder.centres[triangle][axis] = 0.5f * box.low[axis] + 0.5f * box.high[axis];
    }
    order_[triangle] = static_cast<std::int32_t>(triangle);
  }
  nodes_.reserve(face_count / 2 + 1);
  nodes_.resize(1);
  builder.build(0, {0, static_cast<std::uint32_t>(face_count)}, 0);
  corners_.resize(face_count);
  for (std::size_t place = 0; place < face_count; ++place) {
    for (int corner = 0; corner < 3; ++corner) {
      const float* point = vertices + 3 * std::size_t(faces[3 * std::size_t(order_[place]) + corner]);
      std::copy(point, point + 3, corners_[place].begin() + 3 * corner);
      for (int axis = 0; axis < 3; ++axis) reach_ = std::max(reach_, std::abs(point[axis]));
    }
  }
}

// Front to back; `visit(place, ray)` looks at one triangle, may lower what `limit` refers to, returns true to stop.
template <class Visit>
void TriangleBvh::traverse(const double origin[3], const double direction[3], const double& limit,
                           Visit&& visit) const {
  struct Entry {
    float distance;
    std::uint32_t first, count;
  };
  const Ray ray(origin, direction, reach_);
  Entry stack[kStackSize];
  int size = 0;
  stack[size++] = {0.0f, 0, 0};
  while (size > 0) {
    const Entry entry = stack[--size];
    const float float_limit = std::nextafter(static_cast<float>(limit), INFINITY);
    if (entry.distance > float_limit) continue;
    for (std::uint32_t place = entry.first; place < entry.first + entry.count; ++place) {
      if (visit(place, ray)) return;
    }
    if (entry.count > 0) continue;
    const Node& node = nodes_[entry.first];
    Float4 near, far;
    ray.enter(node.low, node.high, float_limit, near, far);
    const int base = size;
    for (int child = 0; child < 4; ++child) {
      if (!(near[child] <= far[child]) || (node.count[child] == 0 && node.first[child] == 0)) continue;
      int place = size++;
      for (; place > base && stack[place - 1].distance < near[child]; --place) stack[place] = stack[place - 1];
      stack[place] = {near[child], node.first[child], node.count[child]};
    }
  }
}

RayHit TriangleBvh::closest(const double origin[3], const double direction[3]) const {
  RayHit best;
  traverse(origin, direction, best.t, [&](std::uint32_t place, const Ray& ray) {
    RayHit hit;
    if (!ray.intersect(corners_[place], hit)) return false;
    hit.triangle = order_[place];
    if (hit.t < best.t || (hit.t == best.t && hit.triangle < best.triangle)) best = hit;
    return false;
  });
  return best;
}

bool TriangleBvh::occluded(const double origin[3], const double direction[3], double max_t) const {
  bool found = false;
  traverse(origin, direction, max_t, [&](std::uint32_t place, const Ray& ray) {
    RayHit hit;
    found = ray.intersect(corners_[place], hit) && hit.t < max_t;
    return found;
  });
  return found;
}

std::int32_t TriangleBvh::winding(const double origin[3], const double direction[3]) const {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  std::int32_t sum = 0;
  traverse(origin, direction, kFar, [&](std::uint32_t place, const Ray& ray) {
    RayHit hit;
    if (ray.intersect(corners_[place], hit)) sum += hit.back ? 1 : -1;
    return false;
  });
  return sum;
}

}  // namespace goc
