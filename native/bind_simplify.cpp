// Python sees goc._native.simplify; src/goc/geometry/simplify.py is what the rest of goc uses.
#include "simplify.hpp"

#include <cstring>
#include <utility>

#include "arrays.hpp"

namespace goc {
namespace {

template <class T, class Shape>
using Rows = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T> moved(std::vector<T>&& values, std::size_t columns) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  if (columns == 1) return nb::ndarray<nb::numpy, T>(kept->data(), {kept->size()}, owner);
  return nb::ndarray<nb::numpy, T>(kept->data(), {kept->size() / columns, columns}, owner);
}

nb::tuple simplified(Rows<float, nb::shape<-1, 3>> vertices, Rows<std::int32_t, nb::shape<-1, 3>> faces,
                     Rows<float, nb::shape<-1, 3>> values, Rows<std::uint8_t, nb::shape<-1>> groups, double tolerance,
                     std::size_t wanted, double quality, double value) {
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
  return nb::make_tuple(moved(std::move(mesh.vertices), 3), moved(std::move(mesh.faces), 3),
                        moved(std::move(mesh.values), 3), moved(std::move(mesh.groups), 1));
}

}  // namespace

void bind_simplify(nb::module_& module) {
  module.def("simplify", &simplified, nb::arg("vertices"), nb::arg("faces"), nb::arg("values"), nb::arg("groups"),
             nb::arg("tolerance"), nb::arg("wanted"), nb::arg("quality"), nb::arg("value"),
             "Vertices, faces, values and groups of a lighter closed mesh.");
}

}  // namespace goc
