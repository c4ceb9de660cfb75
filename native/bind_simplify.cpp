// Python sees goc._native.simplify; src/goc/geometry/simplify.py is what the rest of goc uses.
#include "simplify.hpp"

#include <nanobind/stl/tuple.h>

#include <tuple>
#include <utility>

#include "arrays.hpp"

namespace goc {
namespace {

template <class T, class Shape>
using Rows = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;

template <class T, class Shape>
using Made = nb::ndarray<nb::numpy, T, Shape>;
using Triples = nb::shape<-1, 3>;
using Simplified = std::tuple<Made<float, Triples>, Made<std::int32_t, Triples>, Made<float, Triples>,
                              Made<std::uint8_t, nb::shape<-1>>>;

template <class T>
nb::capsule owner_of(std::vector<T>* kept) {
  return nb::capsule(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
}

template <class T>
Made<T, Triples> triples(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  return Made<T, Triples>(kept->data(), {kept->size() / 3, 3}, owner_of(kept));
}

template <class T>
Made<T, nb::shape<-1>> line(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  return Made<T, nb::shape<-1>>(kept->data(), {kept->size()}, owner_of(kept));
}

Simplified simplified(Rows<float, Triples> vertices, Rows<std::int32_t, Triples> faces, Rows<float, Triples> values,
                      Rows<std::uint8_t, nb::shape<-1>> groups, double tolerance, std::size_t wanted, double quality,
                      double value) {
  const std::size_t count = vertices.shape(0);
  check(values.shape(0) == count && groups.shape(0) == count, "simplify: one value and one group a vertex");
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const std::int32_t vertex = faces.data()[i];
    check(vertex >= 0 && static_cast<std::size_t>(vertex) < count, "simplify: a face names a vertex that is not there");
  }
  Surface mesh{{vertices.data(), vertices.data() + vertices.size()},
               {faces.data(), faces.data() + faces.size()},
               {values.data(), values.data() + values.size()},
               {groups.data(), groups.data() + groups.size()}};
  {
    nb::gil_scoped_release release;
    mesh = simplify(std::move(mesh), {tolerance, wanted, quality, value});
  }
  return {triples(std::move(mesh.vertices)), triples(std::move(mesh.faces)), triples(std::move(mesh.values)),
          line(std::move(mesh.groups))};
}

}  // namespace

void bind_simplify(nb::module_& module) {
  module.def("simplify", &simplified, nb::arg("vertices"), nb::arg("faces"), nb::arg("values"), nb::arg("groups"),
             nb::arg("tolerance"), nb::arg("wanted"), nb::arg("quality"), nb::arg("value"),
             "Vertices, faces, values and groups of a lighter closed mesh.");
}

}  // namespace goc
