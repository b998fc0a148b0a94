// certificate_report: how often fields decide a segment and how often certified answers are wrong, per mesh, risk class
// and kind of segment. The figures of docs/decisions/003-certificates.md.
//
// certificate_report [MESH ...] [--directions D] [--plane N] [--lines K] [--clusters M] [--seed S]
// Draws M random lines per kind of query; clusters of 8 lines within one cell's extent share the cost of its bake.
// Answers are compared with Embree on the same segments, which the bake never sees.
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_procedural.h"
#include "core/mesh/mesh_stress.h"
#include "core/trace/accel.h"
#include "field/bake/cell_lines.h"
#include "field/bake/single_ray_query.h"
#include "field/store/risk_classes.h"

namespace fieldtrace {
namespace {

constexpr int k_cluster = 8;
// An answer is attributed to the smallest of these class limits at which it is given.
constexpr int k_limits[] = {0, 1, 2, 4, 8, k_worst_class};
constexpr int k_limit_count = int(std::size(k_limits));

struct Random {
  explicit Random(uint32_t seed) : engine(seed) {}
  float uniform() { return float(engine() >> 8) * 0x1p-24f; }
  Vec3 direction() {
    const float z = 1.0f - 2.0f * uniform(), phi = 2.0f * k_pi * uniform(), r = std::sqrt(1.0f - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
  }
  std::mt19937 engine;
};

struct Segment {
  Vec3 o, d;
  float t_max;
  bool self;
};

struct Object {
  explicit Object(TriangleMesh mesh) {
    Shape shape;
    shape.mesh = std::move(mesh);
    shape.bounds = shape.mesh.bounds();
    scene.shapes.push_back(std::move(shape));
    accel = std::make_unique<Accel>(scene);
    double sum = 0.0;
    for (const UVec3& t : mesh_ref().triangles) {
      const auto& p = mesh_ref().positions;
      sum += glm::length(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]));
      area.push_back(sum);
    }
  }
  const TriangleMesh& mesh_ref() const { return scene.shapes[0].mesh; }

  Scene scene;
  std::unique_ptr<Accel> accel;
  std::vector<double> area;  // cumulative triangle areas
};

// A surface point, uniform by area and offset by its rounding error, with the normal of one side (random if
// either_side).
struct SurfacePoint {
  Vec3 position, normal;
};
SurfacePoint surface_point(const Object& object, Random& random, bool either_side) {
  const TriangleMesh& mesh = object.mesh_ref();
  const double at = double(random.uniform()) * object.area.back();
  const size_t i = size_t(std::upper_bound(object.area.begin(), object.area.end(), at) - object.area.begin());
  const UVec3 t = mesh.triangles[std::min(i, mesh.triangles.size() - 1)];
  const Vec3 a = mesh.positions[t.x], b = mesh.positions[t.y], c = mesh.positions[t.z];
  const float r = std::sqrt(random.uniform()), s = random.uniform();
  SurfacePoint p;
  p.position = a * (1.0f - r) + b * (r * (1.0f - s)) + c * (r * s);
  p.normal = glm::normalize(glm::cross(b - a, c - a));
  if (either_side && random.uniform() < 0.5f) p.normal = -p.normal;
  const Vec3 m = glm::max(glm::abs(a), glm::max(glm::abs(b), glm::abs(c)));
  p.position += p.normal * (gamma_bound(16) * (m.x + m.y + m.z));
  return p;
}

// Generates k_cluster segments that are close together in the chart.
using Generator = std::function<void(const Object&, const Field&, Random&, std::vector<Segment>&)>;

void outside_outside(const Object&, const Field& field, Random& random, std::vector<Segment>& out) {
  const FieldParameters& p = field.parameters();
  Vec3 d = random.direction();
  if (d.z < 0.0f) d = -d;
  const Vec3 side = random.direction();
  const Vec3 x = glm::normalize(glm::cross(d, side)), y = glm::cross(d, x);
  const float r = std::sqrt(random.uniform()), phi = 2.0f * k_pi * random.uniform();
  const Vec3 foot = (x * std::cos(phi) + y * std::sin(phi)) * r;
  const auto at = scalar::address_of_line<float>({d.x, d.y, d.z}, {foot.x, foot.y, foot.z}, make_axis(p.directions),
                                                 make_axis(p.plane));
  const CellFrame frame = cell_frame(at.u, at.v, p.directions);
  for (int k = 0; k < k_cluster; ++k) {
    const Line line = foot_line(frame, at.u, at.v, at.a, at.b,
                                {random.uniform(), random.uniform(), random.uniform(), random.uniform()}, p);
    const Vec3 o = field.ball().centre + (line.foot - line.direction * 3.0f) * field.ball().radius;
    out.push_back({o, line.direction * (6.0f * field.ball().radius), 1.0f, false});
  }
}

void from_surface(const Object& object, const Field& field, Random& random, std::vector<Segment>& out, bool either) {
  const SurfacePoint at = surface_point(object, random, either);
  Vec3 d = random.direction();
  if (glm::dot(d, at.normal) < 0.0f) d = -d;
  const float spread = 1.0f / float(field.parameters().directions);
  for (int k = 0; k < k_cluster; ++k) {
    Vec3 e = glm::normalize(d + random.direction() * spread);
    if (glm::dot(e, at.normal) <= 0.0f) e = d;
    out.push_back({at.position, e * (6.0f * field.ball().radius), 1.0f, true});
  }
}

// From a point within the ball (not on the object) to a light outside.
void inside_outside(const Object&, const Field& field, Random& random, std::vector<Segment>& out) {
  const Vec3 p = random.direction() * std::cbrt(random.uniform());
  const Vec3 d = random.direction();
  const float spread = 1.0f / float(field.parameters().directions);
  for (int k = 0; k < k_cluster; ++k) {
    const Vec3 e = glm::normalize(d + random.direction() * spread);
    out.push_back({field.ball().centre + p * field.ball().radius, e * (6.0f * field.ball().radius), 1.0f, false});
  }
}

struct Tally {
  uint64_t answers[2] = {0, 0}, wrong[2] = {0, 0};  // clear, blocked
};

struct Result {
  uint64_t queries = 0;
  Tally at[k_limit_count];  // additional answers at this class limit
};

Result measure(const Object& object, Field& field, SingleRayQuery& query, const Generator& generate, int clusters,
               uint32_t seed) {
  Random random(seed);
  Result result;
  std::vector<Segment> segments;
  RayBatch rays;
  std::vector<uint8_t> blocked;
  float to_unit[12];
  write_unit_transform(Affine(1.0f), field.ball(), to_unit);
  for (int c = 0; c < clusters; ++c) {
    segments.clear();
    generate(object, field, random, segments);
    rays.resize(segments.size());
    blocked.resize(padded(segments.size()));
    for (size_t i = 0; i < segments.size(); ++i) rays.set(i, segments[i].o, segments[i].d, segments[i].t_max);
    object.accel->shape_occluded(0, rays, blocked.data());
    for (size_t i = 0; i < segments.size(); ++i) {
      const Segment& s = segments[i];
      const auto unit = scalar::segment_in_unit_space(to_unit, {s.o.x, s.o.y, s.o.z}, {s.d.x, s.d.y, s.d.z}, s.t_max);
      if (!unit.crosses) continue;
      ++result.queries;
      for (int l = 0; l < k_limit_count; ++l) {
        const QueryPolicy policy = {.visibility_max_class = k_limits[l], .depth_max_class = k_limits[l]};
        const FieldVerdict verdict = query.occluded(policy, s.o, s.d, s.t_max, s.self);
        if (verdict == FieldVerdict::undecided) continue;
        const int b = verdict == FieldVerdict::blocked;
        ++result.at[l].answers[b];
        result.at[l].wrong[b] += blocked[i] != b;
        break;
      }
    }
  }
  return result;
}

double percent(uint64_t part, uint64_t whole) { return whole ? 100.0 * double(part) / double(whole) : 0.0; }

void print(const std::string& name, const std::string& kind, const FieldParameters& p, const Result& r) {
  std::printf("%-9s %4d %4d %3d  %-8s", name.c_str(), p.directions, p.plane, p.lines, kind.c_str());
  uint64_t answers = 0, wrong = 0;
  for (int l = 0; l < k_limit_count; ++l) {
    const Tally& t = r.at[l];
    answers += t.answers[0] + t.answers[1];
    wrong += t.wrong[0] + t.wrong[1];
    if (l <= 1) {
      std::printf(" | %d: undecided %5.2f wrong %6.3f", k_limits[l], 100.0 - percent(answers, r.queries),
                  percent(wrong, answers));
    }
  }
  std::printf(" | clear %6.3f blocked %6.3f | by class",
              percent(r.at[0].wrong[0] + r.at[1].wrong[0], r.at[0].answers[0] + r.at[1].answers[0]),
              percent(r.at[0].wrong[1] + r.at[1].wrong[1], r.at[0].answers[1] + r.at[1].answers[1]));
  for (const Tally& t : r.at) std::printf(" %.2f", percent(t.wrong[0] + t.wrong[1], t.answers[0] + t.answers[1]));
  std::printf(" | undecided at class limit");
  uint64_t given = 0;
  for (const Tally& t : r.at) {
    given += t.answers[0] + t.answers[1];
    std::printf(" %.1f", 100.0 - percent(given, r.queries));
  }
  std::printf("\n");
}

// Share of new lines through plane-fit cells that lie farther off than r times the largest residual, r = 1, 1.5, 2, 3.
void print_residuals(const Object& object, Field& field, SingleRayQuery& query, int clusters) {
  const FieldParameters& p = field.parameters();
  Random random(77);
  constexpr float k_factors[] = {1.0f, 1.5f, 2.0f, 3.0f};
  uint64_t beyond[4] = {}, lines = 0;
  RayBatch rays;
  ShapeHits hits;
  for (int c = 0; c < clusters; ++c) {
    const SurfacePoint at = surface_point(object, random, false);
    Vec3 d = random.direction();
    if (glm::dot(d, at.normal) > 0.0f) d = -d;
    query.nearest({}, at.position - d, d, 0.0f, k_infinity, false);
    const Vec3 o = (at.position - field.ball().centre) * (1.0f / field.ball().radius);
    const auto cell =
        scalar::address_of_line<float>({d.x, d.y, d.z}, {o.x, o.y, o.z}, make_axis(p.directions), make_axis(p.plane));
    const FieldView view = field.view();
    const auto slot = scalar::slot_of<float>(view, cell);
    const int32_t certificate = view.certificate[slot.cell], word = view.depth[slot.cell];
    if ((certificate & 3) != scalar::k_kind_plane_fit || ((certificate >> 2) & 63) > 1) continue;
    const float e = scalar::decode_error<float>(certificate);
    const float residual = (e - scalar::k_depth_quantum) / k_residual_factor;
    const float depth = scalar::decode_depth<float>(word);
    const auto normal = scalar::decode_normal<float>(word);
    const Vec3 n(normal.x, normal.y, normal.z);
    const CellFrame frame = cell_frame(cell.u, cell.v, p.directions);
    const Vec3 hit = frame.s * scalar::centre_of<float>(cell.a, make_axis(p.plane)) +
                     frame.t * scalar::centre_of<float>(cell.b, make_axis(p.plane)) + frame.c * depth;
    rays.resize(k_cluster);
    hits.resize(k_cluster);
    std::vector<Line> fresh;
    for (int k = 0; k < k_cluster; ++k) {
      fresh.push_back(depth_line(frame, cell.u, cell.v, cell.a, cell.b, depth,
                                 {random.uniform(), random.uniform(), random.uniform(), random.uniform()}, p));
      const Vec3 from = field.ball().centre + (fresh[k].foot - fresh[k].direction * 2.0f) * field.ball().radius;
      rays.set(size_t(k), from, fresh[k].direction * field.ball().radius, 4.0f);
    }
    object.accel->shape_intersect(0, rays, hits);
    for (int k = 0; k < k_cluster; ++k) {
      ++lines;
      const Vec3 x = fresh[k].foot + fresh[k].direction * (hits.t[size_t(k)] - 2.0f);
      const float off = hits.t[size_t(k)] < 0.0f ? k_infinity : std::abs(glm::dot(x - hit, n));
      for (int f = 0; f < 4; ++f) beyond[f] += off > k_factors[f] * residual + scalar::k_depth_quantum;
    }
  }
  std::printf("          fresh lines beyond 1, 1.5, 2, 3 x the largest residual: %.2f %.2f %.2f %.2f %%\n",
              percent(beyond[0], lines), percent(beyond[1], lines), percent(beyond[2], lines),
              percent(beyond[3], lines));
}

TriangleMesh mesh_by_name(const std::string& name) {
  if (name == "knot") return make_knot();
  if (name == "supershape") return make_supershape();
  if (name == "sphere") return make_sphere();
  if (name == "cube") return make_cube();
  if (name == "comb") return make_comb();
  if (name == "globe") return make_wire_globe();
  if (name == "hair") return make_hair_ball();
  if (name == "sheet") return make_wavy_sheet();
  if (name == "holes") return make_holy_sphere();
  if (name == "slivers") return make_sliver_fan();
  return load_mesh(name == "bunny" ? "/usr/share/glmark2/models/bunny.obj" : name);
}

void report(const std::string& name, const FieldParameters& parameters, int clusters, uint32_t seed) {
  const Object object(mesh_by_name(name));
  Field field(field_ball(object.scene.shapes[0].bounds), parameters);
  SingleRayQuery query(field, *object.accel, 0);
  const bool open = name == "sheet" || name == "holes" || name == "slivers";
  print(name, "out-out", parameters, measure(object, field, query, outside_outside, clusters, seed));
  const double rays_line = double(query.counters().rays) / double(std::max<uint64_t>(field.cells_baked(), 1));
  const uint64_t cells = field.cells_baked(), rays = query.counters().rays;
  print(name, "surface", parameters,
        measure(
            object, field, query,
            [open](const Object& o, const Field& f, Random& r, std::vector<Segment>& out) {
              from_surface(o, f, r, out, open);
            },
            clusters, seed + 1));
  const double rays_depth =
      double(query.counters().rays - rays) / double(std::max<uint64_t>(field.cells_baked() - cells, 1));
  print(name, "in-out", parameters, measure(object, field, query, inside_outside, clusters, seed + 2));
  print_residuals(object, field, query, clusters);
  std::printf("          bake rays per cell: visibility %.1f, depth %.1f; %.2f s\n", rays_line, rays_depth,
              query.counters().seconds);
  std::fflush(stdout);
}

int run(int argc, char** argv) {
  FieldParameters parameters;
  int clusters = 4000, seed = 1;
  std::vector<std::string> names;
  for (int i = 1; i < argc; ++i) {
    const std::string arg = argv[i];
    const std::map<std::string, int*> options = {{"--directions", &parameters.directions},
                                                 {"--plane", &parameters.plane},
                                                 {"--lines", &parameters.lines},
                                                 {"--clusters", &clusters},
                                                 {"--seed", &seed}};
    const auto option = options.find(arg);
    if (option == options.end()) {
      names.push_back(arg);
    } else if (i + 1 < argc) {
      *option->second = std::atoi(argv[++i]);
    }
  }
  if (names.empty()) {
    names = {"bunny", "knot", "supershape", "sphere", "comb", "globe", "hair", "sheet", "holes", "slivers"};
  }
  std::printf(
      "mesh         D    N   K  segment  | undecided and wrong answers, %%, for class limits 0 and 1 | wrong "
      "by verdict (limit 1) | wrong among the answers that class limit 0 1 2 4 8 15 adds | undecided at these "
      "limits\n");
  for (const std::string& name : names) report(name, parameters, clusters, uint32_t(seed));
  return 0;
}

}  // namespace
}  // namespace fieldtrace

int main(int argc, char** argv) {
  try {
    return fieldtrace::run(argc, argv);
  } catch (const std::exception& e) {
    std::cerr << "certificate_report: " << e.what() << "\n";
    return 1;
  }
}
