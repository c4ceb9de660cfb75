// Python sees goc._native.TriangleBvh; src/goc/geometry/raycast.py is what the rest of goc uses.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <stdexcept>

#include "raycast.hpp"
#include "threads.hpp"

namespace nb = nanobind;
using nb::literals::operator""_a;

namespace goc {
namespace {

constexpr std::size_t kGrain = 512;

template <class T, class Shape>
using In = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
template <class T, class Shape>
using Out = nb::ndarray<T, Shape, nb::c_contig, nb::device::cpu>;
using Triples = In<double, nb::shape<-1, 3>>;

TriangleBvh* make_bvh(In<float, nb::shape<-1, 3>> vertices, In<std::int32_t, nb::shape<-1, 3>> faces) {
  const std::size_t face_count = faces.shape(0);
  if (face_count == 0) throw std::invalid_argument("TriangleBvh: no faces");
  for (std::size_t i = 0; i < 3 * face_count; ++i) {
    const std::int32_t index = faces.data()[i];
    if (index < 0 || static_cast<std::size_t>(index) >= vertices.shape(0)) {
      throw std::invalid_argument("TriangleBvh: a face names a vertex that is not there");
    }
  }
  nb::gil_scoped_release release;
  return new TriangleBvh(vertices.data(), faces.data(), face_count);
}

void closest_hits(const TriangleBvh& bvh, Triples origins, Triples directions, Out<double, nb::shape<-1>> t,
                 Out<std::int32_t, nb::shape<-1>> triangles, Out<double, nb::shape<-1, 3>> barycentrics) {
  const std::size_t count = origins.shape(0);
  if (directions.shape(0) != count || t.shape(0) != count || triangles.shape(0) != count ||
      barycentrics.shape(0) != count) {
    throw std::invalid_argument("closest_hit: arrays of different lengths");
  }
  nb::gil_scoped_release release;
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const RayHit hit = bvh.closest(origins.data() + 3 * i, directions.data() + 3 * i);
      t.data()[i] = hit.t;
      triangles.data()[i] = hit.triangle;
      double* weights = barycentrics.data() + 3 * i;
      weights[0] = hit.u;
      weights[1] = hit.v;
      weights[2] = hit.w;
    }
  });
}

void occlusions(const TriangleBvh& bvh, Triples origins, Triples directions, In<double, nb::shape<-1>> max_distances,
              Out<bool, nb::shape<-1>> blocked) {
  const std::size_t count = origins.shape(0);
  if (directions.shape(0) != count || max_distances.shape(0) != count || blocked.shape(0) != count) {
    throw std::invalid_argument("occluded: arrays of different lengths");
  }
  nb::gil_scoped_release release;
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      blocked.data()[i] = bvh.occluded(origins.data() + 3 * i, directions.data() + 3 * i, max_distances.data()[i]);
    }
  });
}

void windings(const TriangleBvh& bvh, Triples origins, In<double, nb::shape<3>> direction,
              Out<std::int32_t, nb::shape<-1>> numbers) {
  const std::size_t count = origins.shape(0);
  if (numbers.shape(0) != count) throw std::invalid_argument("winding: arrays of different lengths");
  nb::gil_scoped_release release;
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      numbers.data()[i] = bvh.winding(origins.data() + 3 * i, direction.data());
    }
  });
}

void nearest_triangles(const TriangleBvh& bvh, Triples points, In<double, nb::shape<-1>> limits,
                       Out<double, nb::shape<-1>> distances, Out<std::int32_t, nb::shape<-1>> triangles) {
  const std::size_t count = points.shape(0);
  if (limits.shape(0) != count || distances.shape(0) != count || triangles.shape(0) != count) {
    throw std::invalid_argument("nearest: arrays of different lengths");
  }
  nb::gil_scoped_release release;
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Nearest found = bvh.nearest(points.data() + 3 * i, limits.data()[i]);
      distances.data()[i] = found.distance;
      triangles.data()[i] = found.triangle;
    }
  });
}

void all_crossings(const TriangleBvh& bvh, In<bool, nb::shape<-1>> asked, Out<std::int32_t, nb::shape<-1>> counts) {
  if (counts.shape(0) != bvh.size() || asked.shape(0) != bvh.size()) {
    throw std::invalid_argument("crossings: one count a triangle");
  }
  nb::gil_scoped_release release;
  parallel_for(bvh.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t place = begin; place < end; ++place) {
      const std::int32_t triangle = bvh.triangle_at(place);
      if (asked.data()[triangle]) counts.data()[triangle] = bvh.crossings(place);
    }
  });
}

}  // namespace

void bind_raycast(nb::module_& module) {
  nb::class_<TriangleBvh>(module, "TriangleBvh", "A bounding-volume hierarchy over a triangle soup.")
      .def(nb::new_(&make_bvh), "vertices"_a, "faces"_a)
      .def("closest_hit", &closest_hits, "origins"_a, "directions"_a, "t"_a, "triangles"_a, "barycentrics"_a,
           "Fill t (infinity: none), triangle (-1: none) and barycentric weights of each ray's nearest hit.")
      .def("occluded", &occlusions, "origins"_a, "directions"_a, "max_distances"_a, "blocked"_a,
           "Fill whether each ray hits anything before its maximal distance.")
      .def("winding", &windings, "origins"_a, "direction"_a, "numbers"_a,
           "Fill how often a ray from each origin leaves the surface more than it enters.")
      .def("nearest", &nearest_triangles, "points"_a, "limits"_a, "distances"_a, "triangles"_a,
           "Fill distance (infinity: none within the limit) and triangle (-1: none) nearest to each point.")
      .def("crossings", &all_crossings, "asked"_a, "counts"_a,
           "Fill how many other triangles each triangle asked for cuts.");
}

}  // namespace goc
