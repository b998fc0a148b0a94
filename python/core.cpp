// The Python module fieldtrace._core over the C interface. Arrays are read in place where they are C-contiguous and of
// the right type, else numpy converts them first. The GIL is released while the library works.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <memory>
#include <optional>
#include <string>

#include "fieldtrace/fieldtrace.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Vectors = nb::ndarray<const float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Floats = nb::ndarray<const float, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using Triangles = nb::ndarray<const uint32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Transform = nb::ndarray<const float, nb::shape<3, 4>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<nb::numpy, uint8_t, nb::shape<-1>>;
using Picture = nb::ndarray<nb::numpy, float, nb::shape<-1, -1, 3>>;

// An array that owns what it shows.
template <class Array, class T>
Array own(std::unique_ptr<T[]> data, std::initializer_list<size_t> shape) {
  T* const values = data.release();
  const nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return Array(values, shape, owner);
}

// The matrix's columns x, y, z and translation.
struct Columns {
  float values[12];
  explicit Columns(const Transform& t) {
    for (size_t c = 0; c < 4; ++c) {
      for (size_t r = 0; r < 3; ++r) values[3 * c + r] = t(r, c);
    }
  }
};

Bytes occluded(const ft::Scene& scene, const Vectors& origins, const Vectors& directions,
               const std::optional<Floats>& t_max, bool certified) {
  const size_t count = origins.shape(0);
  if (directions.shape(0) != count || (t_max && t_max->shape(0) != count))
    throw nb::value_error("origins, directions and tmax have different lengths");
  auto results = std::make_unique<uint8_t[]>(count);
  {
    const nb::gil_scoped_release released;
    const auto function = certified ? ftOccludedCertified : ftOccluded;
    scene.check(function(scene.get(), origins.data(), 0, directions.data(), 0, t_max ? t_max->data() : nullptr, 0,
                         nullptr, 0, count, results.get(), 0));
  }
  return own<Bytes>(std::move(results), {count});
}

Picture render(ft::Scene& scene) {
  const auto width = size_t(scene.get_int("width")), height = size_t(scene.get_int("height"));
  auto pixels = std::make_unique<float[]>(width * height * 3);
  {
    const nb::gil_scoped_release released;
    scene.render(pixels.get());
  }
  return own<Picture>(std::move(pixels), {height, width, 3});
}

}  // namespace

NB_MODULE(_core, m) {
  nb::exception<ft::Error>(m, "Error", PyExc_RuntimeError);
  nb::class_<ft::Scene>(m, "Scene")
      .def(
          "__init__",
          [](ft::Scene* self, const std::optional<std::string>& path, uint32_t threads) {
            if (path) {
              new (self) ft::Scene(ft::Device(threads), *path);
            } else {
              new (self) ft::Scene(ft::Device(threads));
            }
          },
          "path"_a = nb::none(), "threads"_a = 0)
      .def(
          "add_mesh",
          [](ft::Scene& s, const Vectors& positions, const Triangles& triangles) {
            return s.add_mesh(positions.data(), positions.shape(0), triangles.data(), triangles.shape(0));
          },
          "positions"_a, "triangles"_a)
      .def(
          "add_instance",
          [](ft::Scene& s, uint32_t mesh, const std::optional<Transform>& transform) {
            return transform ? s.add_instance(mesh, Columns(*transform).values) : s.add_instance(mesh);
          },
          "mesh"_a, "transform"_a = nb::none())
      .def(
          "set_transform",
          [](ft::Scene& s, uint32_t instance, const Transform& t) { s.set_transform(instance, Columns(t).values); },
          "instance"_a, "transform"_a)
      .def("set", [](ft::Scene& s, const std::string& name, int64_t value) { s.set(name.c_str(), value); })
      .def("set_float", [](ft::Scene& s, const std::string& name, double v) { s.set_float(name.c_str(), v); })
      .def("get", [](const ft::Scene& s, const std::string& name) { return s.get_int(name.c_str()); })
      .def("commit", &ft::Scene::commit, nb::call_guard<nb::gil_scoped_release>())
      .def("bake", &ft::Scene::bake, nb::call_guard<nb::gil_scoped_release>())
      .def("occluded", &occluded, "origins"_a, "directions"_a, "tmax"_a = nb::none(), "certified"_a = false)
      .def("render", &render);
}
