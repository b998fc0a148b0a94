#include "tools/thesis/measure.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>

#include "core/io/scratch_folder.h"
#include "core/platform/stopwatch.h"
#include "field/file/thesis_file.h"
#include "tools/report/embedded_picture.h"
#include "tools/thesis/chart_rows.h"
#include "tools/thesis/hybrid_rows.h"
#include "tools/thesis/picture.h"
#include "tools/thesis/render.h"

namespace fieldtrace {
namespace {

constexpr float k_difference_gain = 4.0f;

// Thrown to end the run early; never leaves run_thesis.
struct Stopped {};

struct BakedObject {
  ThesisField field;
  double seconds = 0;
  uint64_t bytes_vdb = 0;
};

// A case with the data that its references need.
struct PreparedCase {
  ThesisCase description;
  std::unique_ptr<Accel> accel;
  PhongPicture reference, polished;
};

class ThesisRun {
 public:
  ThesisRun(const ThesisRunOptions& options, const ThesisRunCallbacks& callbacks, ThesisReport& report)
      : options_(options), callbacks_(callbacks), report_(report) {}

  void run() {
    report_.size = options_.size();
    report_.threads = tbb::this_task_arena::max_concurrency();
    report_.isa = isa_name(resolve_isa(options_.isa));
    report_.quick = options_.quick;
    const std::vector<size_t> growth = options_.quick ? std::vector<size_t>{16128, 65536}
                                                      : std::vector<size_t>{16128, 65536, 262144, 1048576, 2000000};
    const int growth_m = options_.quick ? 32 : 64;
    std::vector<ThesisCase> cases = thesis_cases(options_.bunny);
    estimate(cases, double(growth.size()) * growth_m * growth_m);
    std::vector<PreparedCase> prepared;
    for (ThesisCase& c : cases) prepared.push_back(prepare(std::move(c)));
    for (const int m : options_.resolutions()) {
      objects_.clear();  // those of M = 128 take a quarter of a gigabyte each
      for (size_t i = 0; i < prepared.size(); ++i) measure(prepared[i], m, report_.cases[i]);
      for (const PreparedCase& p : prepared) compare(p, m);
    }
    objects_.clear();
    prepared.clear();
    for (const size_t triangles : growth) grow(triangles, growth_m);
    stage_ = "own renderers";
    report(0.0);
    if (!measure_hybrid(cases_for_hybrid(), options_.quick, options_.scratch_folder, callbacks_.stop, report_.hybrid))
      throw Stopped();
  }

 private:
  void check_stop() const {
    if (callbacks_.stop && *callbacks_.stop) throw Stopped();
  }

  // Baking is nearly all of the work: M^2 per object.
  void estimate(const std::vector<ThesisCase>& cases, double growth) {
    std::map<std::string, int> shapes;
    for (const ThesisCase& c : cases) {
      for (const Shape& s : c.scene.geometry.shapes) ++shapes[s.name];
    }
    total_ = growth;
    for (const int m : options_.resolutions()) total_ += double(shapes.size()) * m * m;
    total_ *= 1.1;
  }

  void report(double part) const {
    if (callbacks_.progress) callbacks_.progress(std::min((done_ + part) / total_, 1.0), stage_);
  }

  // Returns the least time of several renders, and the image.
  double time_render(const PhongScene& scene, const PhongTracer& tracer, int reflection_rays,
                     PhongPicture& picture) const {
    const PhongRenderOptions o = {options_.size(), reflection_rays};
    std::vector<double> times;
    for (int k = 0; k < options_.repeats(); ++k) {
      check_stop();
      const auto start = std::chrono::steady_clock::now();
      picture = render_phong(scene, tracer, o);
      times.push_back(1e3 * seconds_since(start));
    }
    return *std::min_element(times.begin(), times.end());
  }

  std::string uri(const PhongPicture& picture) const {
    return png_data_uri(to_image(picture), options_.scratch_folder);
  }

  PreparedCase prepare(ThesisCase&& description) {
    PreparedCase p;
    p.description = std::move(description);
    const PhongScene& scene = p.description.scene;
    stage_ = scene.title;
    report(0.0);
    p.accel = std::make_unique<Accel>(scene.geometry);
    const auto tracer = make_exact_tracer(scene, *p.accel);
    ThesisCaseResult r;
    r.name = scene.name;
    r.title = scene.title;
    r.triangles = scene.geometry.triangle_count();
    r.thesis_triangles = p.description.thesis_triangles;
    r.lights = scene.lights.size();
    r.exact_ms = time_render(scene, *tracer, 1, p.reference);
    r.exact_bytes = p.accel->memory_bytes();
    r.reference_picture = uri(p.reference);
    if (p.description.polished) {
      r.polished_ms = time_render(scene, *tracer, 4, p.polished);
      r.polished_picture = uri(p.polished);
    }
    r.description = p.description;
    r.description.scene.geometry = Scene();
    report_.cases.push_back(std::move(r));
    return p;
  }

  BakedObject bake(const Accel& accel, const Scene& scene, uint32_t shape, int m) {
    ThesisBakeCallbacks callbacks;
    callbacks.stop = callbacks_.stop;
    const double work = double(m) * m;
    callbacks.progress = [&](float share) { report(double(share) * work); };
    const auto start = std::chrono::steady_clock::now();
    std::optional<ThesisField> field = bake_thesis_field(accel, scene, shape, m, callbacks);
    if (!field) throw Stopped();
    done_ += work;
    return {std::move(*field), seconds_since(start), 0};
  }

  uint64_t vdb_bytes(const ThesisField& field, const Shape& shape) const {
    check_stop();
    const ScratchFolder scratch(options_.scratch_folder, "field");
    return save_thesis_field(field, thesis_identity(shape, field.m()), scratch.path() + "/field.vdb");
  }

  // Objects of the same name are identical in all cases.
  const BakedObject& object(const PreparedCase& p, uint32_t shape, int m) {
    const Scene& scene = p.description.scene.geometry;
    const auto found = objects_.find(scene.shapes[shape].name);
    if (found != objects_.end()) return found->second;
    BakedObject baked = bake(*p.accel, scene, shape, m);
    baked.bytes_vdb = vdb_bytes(baked.field, scene.shapes[shape]);
    return objects_.emplace(scene.shapes[shape].name, std::move(baked)).first->second;
  }

  void measure(const PreparedCase& p, int m, ThesisCaseResult& result) {
    const PhongScene& scene = p.description.scene;
    stage_ = scene.title + ", M = " + std::to_string(m);
    ThesisRow row;
    row.m = m;
    std::vector<const ThesisField*> fields;
    for (uint32_t s = 0; s < scene.geometry.shapes.size(); ++s) {
      const BakedObject& baked = object(p, s, m);
      fields.push_back(&baked.field);
      row.bake_seconds += baked.seconds;
      row.bytes_distance += baked.field.bytes_distance();
      row.bytes_normal += baked.field.bytes_normal();
      row.bytes_vdb += baked.bytes_vdb;
    }
    PhongPicture picture;
    row.milliseconds = time_render(scene, *make_field_tracer(scene, fields, options_.isa), 1, picture);
    const PhongPicture smooth = blurred(picture);
    row.rms = rms_255(picture, p.reference);
    row.rms_blurred = rms_255(smooth, p.reference);
    if (p.description.polished) {
      row.rms_polished = rms_255(picture, p.polished);
      row.rms_polished_blurred = rms_255(smooth, p.polished);
    }
    row.picture = uri(picture);
    row.difference_picture = uri(difference(picture, p.reference, k_difference_gain));
    result.rows.push_back(std::move(row));
  }

  // Compares both charts on cases of one object under one light.
  void compare(const PreparedCase& p, int m) {
    const PhongScene& scene = p.description.scene;
    if (scene.geometry.instances.size() != 1 || scene.lights.size() != 1) return;
    stage_ = scene.title + ", both charts, M = " + std::to_string(m);
    check_stop();
    report(0.0);
    compare_charts(scene.title, scene.geometry, *p.accel, object(p, 0, m).field, options_, report_.charts);
  }

  void grow(size_t triangles, int m) {
    const PhongScene scene = thesis_growing_scene(triangles);
    const Accel accel(scene.geometry);
    ThesisGrowth row;
    row.triangles = scene.geometry.triangle_count();
    row.m = m;
    stage_ = std::to_string(row.triangles) + " triangles";
    PhongPicture picture;
    row.exact_ms = time_render(scene, *make_exact_tracer(scene, accel), 1, picture);
    const BakedObject baked = bake(accel, scene.geometry, 0, m);
    row.bake_seconds = baked.seconds;
    row.field_ms = time_render(scene, *make_field_tracer(scene, {&baked.field}, options_.isa), 1, picture);
    report_.growth.push_back(row);
  }

  // The scenes of all cases; the renderers treat mirrors as diffuse surfaces.
  std::vector<PhongScene> cases_for_hybrid() const {
    std::vector<PhongScene> scenes;
    for (ThesisCase& c : thesis_cases(options_.bunny)) scenes.push_back(std::move(c.scene));
    return scenes;
  }

  const ThesisRunOptions& options_;
  const ThesisRunCallbacks& callbacks_;
  ThesisReport& report_;
  std::map<std::string, BakedObject> objects_;
  std::string stage_;
  double done_ = 0, total_ = 1;
};

}  // namespace

bool run_thesis(const ThesisRunOptions& options, const ThesisRunCallbacks& callbacks, ThesisReport& report) {
  try {
    ThesisRun(options, callbacks, report).run();
  } catch (const Stopped&) {
    return false;
  }
  return true;
}

}  // namespace fieldtrace
