// The Python module fieldtrace._core over the C interface (fieldtrace/fieldtrace.h).
//
// It is called by the package's own Python code alone, which converts and checks what users give: arrays come here as
// rows whose numbers lie side by side, with any stride between rows that the C interface takes, and are read and
// written in place. The GIL is released while the library works. Thread-safety: as the C interface.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>

#include <array>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "fieldtrace/fieldtrace.hpp"
#include "gil.h"
#include "long_call.h"

namespace nb = nanobind;
using namespace nb::literals;
using fieldtrace::python::GilReleased;
using fieldtrace::python::LongCalls;

namespace {

template <class T>
using Rows = nb::ndarray<T, nb::ndim<2>, nb::device::cpu>;
template <class T>
using Values = nb::ndarray<T, nb::ndim<1>, nb::device::cpu>;

// Pointer and stride as the C interface takes them. Null: not given.
template <class T>
struct Column {
  T* data = nullptr;
  size_t stride = 0, count = 0;
};

template <class T, class Array>
Column<T> column(const Array& a, const char* name, size_t parts) {
  const size_t count = a.shape(0);
  const int64_t stride = a.stride(0) * int64_t(sizeof(T));
  const bool packed = count <= 1;  // such arrays may have any stride
  bool fits = packed || stride >= int64_t(parts * sizeof(T));
  if (a.ndim() == 2) fits = fits && a.shape(1) == parts && (parts == 1 || count == 0 || a.stride(1) == 1);
  if (!fits) throw nb::value_error((std::string(name) + ": no rows of the expected layout").c_str());
  return {a.data(), packed ? 0 : size_t(stride), count};
}

template <class T>
Column<T> rows(const Rows<T>& a, const char* name, size_t parts, size_t count) {
  const Column<T> c = column<T>(a, name, parts);
  if (c.count != count) throw nb::value_error((std::string(name) + ": another length than the others").c_str());
  return c;
}
template <class T>
Column<T> rows(const Rows<T>& a, const char* name, size_t parts) {
  return column<T>(a, name, parts);
}
template <class T>
Column<T> values(const std::optional<Values<T>>& a, const char* name, size_t count) {
  if (!a) return {};
  const Column<T> c = column<T>(*a, name, 1);
  if (c.count != count) throw nb::value_error((std::string(name) + ": another length than the others").c_str());
  return c;
}

using Columns = std::optional<std::array<float, 12>>;
using Triple = std::array<float, 3>;

// The warnings of a device's calls that nobody has taken yet.
class Warnings {
 public:
  explicit Warnings(FTDevice device) { ft::check(ftSetDeviceWarningCallback(device, &add, this), device); }
  Warnings(const Warnings&) = delete;
  Warnings& operator=(const Warnings&) = delete;

  std::vector<std::string> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(messages_, {});
  }

 private:
  static void add(void* user, const char* message) {
    Warnings& of = *static_cast<Warnings*>(user);
    const std::lock_guard lock(of.mutex_);
    of.messages_.emplace_back(message);
  }

  std::mutex mutex_;
  std::vector<std::string> messages_;
};

// A scene and the device that is its own.
class Scene {
 public:
  explicit Scene(uint32_t threads) : device_(threads), warnings_(device_.get()), scene_(device_) {}
  Scene(uint32_t threads, const std::string& path)
      : device_(threads), warnings_(device_.get()), scene_(device_, path) {}

  FTScene get() const { return scene_.get(); }
  void check(FTError code) const { scene_.check(code); }
  // Calls function(scene, arguments...) without the GIL.
  template <class Function, class... Arguments>
  void call(Function function, Arguments... arguments) const {
    const GilReleased released;
    check(function(get(), arguments...));
  }
  // The same for work that tells its progress and can be cancelled.
  template <class Work>
  void call_long(const nb::object& progress, const Work& work) {
    long_calls_.run(device_.get(), progress, [&] { check(work(get())); });
  }
  // Held where the picture's size must stay as it is, or changes. Never together with the GIL, which others may need
  // to go on.
  std::mutex& size_mutex() { return size_mutex_; }
  std::vector<std::string> take_warnings() { return warnings_.take(); }

 private:
  ft::Device device_;
  Warnings warnings_;
  ft::Scene scene_;
  LongCalls long_calls_;
  std::mutex size_mutex_;
};

std::string text(const nb::bytes& path) { return {path.c_str(), path.size()}; }

uint32_t add_mesh(const Scene& s, const Rows<const float>& positions, const Rows<const uint32_t>& triangles) {
  const auto p = rows(positions, "positions", 3);
  const auto t = rows(triangles, "triangles", 3);
  uint32_t mesh = FT_NO_MESH;
  s.call(ftAddMesh, p.data, p.stride, p.count, t.data, t.stride, t.count, &mesh);
  return mesh;
}

uint32_t add_instance(const Scene& s, uint32_t mesh, const Columns& transform) {
  uint32_t instance = FT_NO_INSTANCE;
  s.call(ftAddInstance, mesh, transform ? transform->data() : nullptr, &instance);
  return instance;
}

void occluded(const Scene& s, bool certified, const Rows<const float>& origins, const Rows<const float>& directions,
              const std::optional<Values<const float>>& t_max, const std::optional<Values<const uint32_t>>& from,
              const Values<uint8_t>& results) {
  const auto o = rows(origins, "origins", 3);
  const auto d = rows(directions, "directions", 3, o.count);
  const auto t = values(t_max, "tmax", o.count);
  const auto f = values(from, "from_instances", o.count);
  const auto r = values(std::optional(results), "results", o.count);
  s.call(certified ? ftOccludedCertified : ftOccluded, o.data, o.stride, d.data, d.stride, t.data, t.stride, f.data,
         f.stride, o.count, r.data, r.stride);
}

void nearest(const Scene& s, float max_error, const Rows<const float>& origins, const Rows<const float>& directions,
             const std::optional<Values<const float>>& t_max, const std::optional<Values<const uint32_t>>& from,
             const Values<uint8_t>& status, const Values<float>& t, const Rows<float>& normals,
             const Values<uint32_t>& triangles, const Values<uint32_t>& instances) {
  const auto o = rows(origins, "origins", 3);
  const auto d = rows(directions, "directions", 3, o.count);
  const auto tm = values(t_max, "tmax", o.count);
  const auto f = values(from, "from_instances", o.count);
  const auto rs = values(std::optional(status), "status", o.count);
  const auto rt = values(std::optional(t), "t", o.count);
  const auto rn = rows(normals, "normals", 3, o.count);
  const auto rp = values(std::optional(triangles), "triangles", o.count);
  const auto ri = values(std::optional(instances), "instances", o.count);
  s.call(ftNearest, max_error, o.data, o.stride, d.data, d.stride, tm.data, tm.stride, f.data, f.stride, o.count,
         rs.data, rs.stride, rt.data, rt.stride, rn.data, rn.stride, rp.data, rp.stride, ri.data, ri.stride);
}

void light_visibility(const Scene& s, const Rows<const float>& points, const Rows<const float>& normals,
                      const std::optional<Values<const uint32_t>>& from, const Values<const uint32_t>& shapes,
                      const Rows<const float>& lights, const Values<float>& shares, const Values<float>& certain) {
  const auto p = rows(points, "points", 3);
  const auto n = rows(normals, "normals", 3, p.count);
  const auto f = values(from, "from_instances", p.count);
  const auto l = rows(lights, "lights", 9);
  const auto k = values(std::optional(shapes), "shapes", l.count);
  const auto rs = values(std::optional(shares), "shares", p.count * l.count);
  const auto rc = values(std::optional(certain), "certain", p.count * l.count);
  s.call(ftLightVisibility, p.data, p.stride, n.data, n.stride, f.data, f.stride, p.count, k.data, k.stride, l.data,
         l.stride, l.count, rs.data, rs.stride, rc.data, rc.stride);
}

void sky_visibility(const Scene& s, const Rows<const float>& points, const Rows<const float>& normals,
                    const Values<const uint32_t>& from, const Values<float>& shares, const Values<float>& certain) {
  const auto p = rows(points, "points", 3);
  const auto n = rows(normals, "normals", 3, p.count);
  const auto f = values(std::optional(from), "from_instances", p.count);
  const auto rs = values(std::optional(shares), "shares", p.count);
  const auto rc = values(std::optional(certain), "certain", p.count);
  s.call(ftSkyVisibility, p.data, p.stride, n.data, n.stride, f.data, f.stride, p.count, rs.data, rs.stride, rc.data,
         rc.stride);
}

void render(Scene& s, const nb::ndarray<float, nb::ndim<3>, nb::c_contig, nb::device::cpu>& pixels,
            const nb::object& progress) {
  const auto rows = int64_t(pixels.shape(0)), columns = int64_t(pixels.shape(1)), channels = int64_t(pixels.shape(2));
  float* const data = pixels.data();
  s.call_long(progress, [&](FTScene scene) {
    const std::lock_guard lock(s.size_mutex());
    int64_t width = 0, height = 0;
    s.check(ftGetSceneInt(scene, "width", &width));
    s.check(ftGetSceneInt(scene, "height", &height));
    if (rows != height || columns != width || channels != 3)
      throw nb::value_error("pixels: not of the picture's size; has another thread set the camera?");
    return ftRender(scene, data, 0, 0);
  });
}

// ft::Error becomes what fieldtrace._errors makes of it. Messages may name files whose names are no UTF-8.
void translate_error(const std::exception_ptr& exception, void*) {
  try {
    std::rethrow_exception(exception);
  } catch (const ft::Error& e) {
    const nb::object message = nb::steal(PyUnicode_DecodeFSDefault(e.what()));
    const nb::object error = nb::module_::import_("fieldtrace._errors").attr("error_of")(int(e.code()), message);
    PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
  }
}

}  // namespace

NB_MODULE(_core, m) {
  nb::set_leak_warnings(false);  // scenes in global variables outlive the module
  nb::register_exception_translator(&translate_error);
  fieldtrace::python::wait_for_calls_at_exit();
  m.def("version", &ftGetVersion);
  nb::class_<Scene>(m, "Scene")
      .def(nb::init<uint32_t>(), "threads"_a)
      .def_static(
          "load",
          [](const nb::bytes& path, uint32_t threads) {
            const std::string file = text(path);
            const GilReleased released;
            return new Scene(threads, file);
          },
          "path"_a, "threads"_a, nb::rv_policy::take_ownership)
      .def("add_mesh", &add_mesh, "positions"_a.noconvert(), "triangles"_a.noconvert())
      .def("add_instance", &add_instance, "mesh"_a, "transform"_a.none())
      .def(
          "set_transform",
          [](const Scene& s, uint32_t instance, const std::array<float, 12>& transform) {
            s.call(ftSetInstanceTransform, instance, transform.data());
          },
          "instance"_a, "transform"_a)
      .def(
          "set_reflectance",
          [](const Scene& s, uint32_t instance, const Triple& rgb) {
            s.call(ftSetInstanceReflectance, instance, rgb.data());
          },
          "instance"_a, "rgb"_a)
      .def(
          "set_radiance",
          [](const Scene& s, uint32_t instance, const Triple& rgb) {
            s.call(ftSetInstanceRadiance, instance, rgb.data());
          },
          "instance"_a, "rgb"_a)
      .def(
          "set_sky", [](const Scene& s, const Triple& rgb) { s.call(ftSetSceneSky, rgb.data()); }, "rgb"_a)
      .def(
          "set_camera",
          [](Scene& s, const Triple& origin, const Triple& target, const Triple& up, float degrees, uint32_t width,
             uint32_t height) {
            s.call([&](FTScene scene) {
              const std::lock_guard lock(s.size_mutex());
              return ftSetSceneCamera(scene, origin.data(), target.data(), up.data(), degrees, width, height);
            });
          },
          "origin"_a, "target"_a, "up"_a, "degrees"_a, "width"_a, "height"_a)
      .def(
          "set_int", [](const Scene& s, const char* name, int64_t value) { s.call(ftSetSceneInt, name, value); },
          "name"_a, "value"_a)
      .def(
          "set_float", [](const Scene& s, const char* name, double value) { s.call(ftSetSceneFloat, name, value); },
          "name"_a, "value"_a)
      .def(
          "get_int",
          [](const Scene& s, const char* name) {
            int64_t value = 0;
            s.call(ftGetSceneInt, name, &value);
            return value;
          },
          "name"_a)
      .def(
          "get_float",
          [](const Scene& s, const char* name) {
            double value = 0;
            s.call(ftGetSceneFloat, name, &value);
            return value;
          },
          "name"_a)
      .def(
          "get_mesh_int",
          [](const Scene& s, uint32_t mesh, const char* name) {
            int64_t value = 0;
            s.call(ftGetMeshInt, mesh, name, &value);
            return value;
          },
          "mesh"_a, "name"_a)
      .def("origin",
           [](const Scene& s) {
             std::array<double, 3> origin = {};
             s.call(ftGetSceneOrigin, origin.data());
             return nb::make_tuple(origin[0], origin[1], origin[2]);
           })
      .def("take_warnings",
           [](Scene& s) {
             nb::list messages;  // bytes: they may name files whose names are no UTF-8
             for (const std::string& message : s.take_warnings())
               messages.append(nb::bytes(message.data(), message.size()));
             return messages;
           })
      .def("commit", [](const Scene& s) { s.call(ftCommitScene); })
      .def(
          "bake", [](Scene& s, const nb::object& progress) { s.call_long(progress, ftBakeFields); },
          "progress"_a.none())
      .def(
          "save_field",
          [](const Scene& s, uint32_t mesh, const nb::bytes& path) { s.call(ftSaveField, mesh, text(path).c_str()); },
          "mesh"_a, "path"_a)
      .def(
          "load_field",
          [](const Scene& s, uint32_t mesh, const nb::bytes& path) { s.call(ftLoadField, mesh, text(path).c_str()); },
          "mesh"_a, "path"_a)
      .def("occluded", &occluded, "certified"_a, "origins"_a.noconvert(), "directions"_a.noconvert(),
           "tmax"_a.noconvert().none(), "from_instances"_a.noconvert().none(), "results"_a.noconvert())
      .def("nearest", &nearest, "max_error"_a, "origins"_a.noconvert(), "directions"_a.noconvert(),
           "tmax"_a.noconvert().none(), "from_instances"_a.noconvert().none(), "status"_a.noconvert(),
           "t"_a.noconvert(), "normals"_a.noconvert(), "triangles"_a.noconvert(), "instances"_a.noconvert())
      .def("light_visibility", &light_visibility, "points"_a.noconvert(), "normals"_a.noconvert(),
           "from_instances"_a.noconvert().none(), "shapes"_a.noconvert(), "lights"_a.noconvert(),
           "shares"_a.noconvert(), "certain"_a.noconvert())
      .def("sky_visibility", &sky_visibility, "points"_a.noconvert(), "normals"_a.noconvert(),
           "from_instances"_a.noconvert(), "shares"_a.noconvert(), "certain"_a.noconvert())
      .def("render", &render, "pixels"_a.noconvert(), "progress"_a.none())
      .def(
          "render_to_file",
          [](Scene& s, const nb::bytes& path, const nb::object& progress) {
            const std::string file = text(path);
            s.call_long(progress, [&](FTScene scene) { return ftRenderToFile(scene, file.c_str()); });
          },
          "path"_a, "progress"_a.none());
}
