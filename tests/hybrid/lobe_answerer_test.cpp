// Glossy rays answered by prefiltered radiance maps: what the maps hold, how they are filtered, and whole renders
// against Monte Carlo.

#include "hybrid/glossy/lobe_answerer.h"

#include <gtest/gtest.h>

#include "core/material/texture.h"
#include "core/mesh/mesh_procedural.h"
#include "hybrid/compare/compare.h"
#include "hybrid/glossy/radiance_maps.h"
#include "hybrid/path/patch_vertex.h"
#include "hybrid/render/render.h"
#include "hybrid/visibility/shadow_answerer.h"
#include "tests/support/field_checks.h"
#include "tests/support/random_lines.h"
#include "tests/support/small_scenes.h"

namespace fieldtrace {
namespace {

using test::SceneMaker;

constexpr float k_albedo = 0.5f;

// A rough metal floor under a knot, lit by a lamp and, if `sky`, by the sky.
SceneMaker glossy_scene(float alpha, bool sky, int resolution = 48) {
  SceneMaker m;
  m.film(resolution, resolution);
  m.scene.camera.to_world = test::look_at({3, 3, 5}, {0, 0.4f, 0}, {0, 1, 0});
  m.scene.integrator.max_depth = 3;
  const uint32_t clay = m.bsdf(BsdfKind::diffuse, Rgb(k_albedo, 0.4f, 0.3f));
  m.scene.bsdfs[clay].two_sided = true;
  const uint32_t metal = m.metal(alpha);
  const uint32_t knot = m.mesh(make_knot({.along = 256, .around = 24}));
  m.instance(knot, clay, test::translation({0, 1.2f, 0}));
  m.lit_floor(metal, clay);
  if (sky) m.light(EmitterKind::constant, Rgb(0.3f));
  return m;
}

RenderOptions options_for(Method method, int lobe_samples) {
  RenderOptions o;
  o.leave_to_rays = false;  // so small a picture would pay for no field
  o.method = method;
  o.spp = 1;
  o.light_samples = 4;
  o.lobe_samples = lobe_samples;
  o.seed = 3;
  o.threads = 2;
  return o;
}

// A crop of a larger film, of which a few tiles are baked.
constexpr int k_film = 128;
RenderOptions crop_options(Method method, int lobe_samples) {
  RenderOptions o = options_for(method, lobe_samples);
  o.crop = Rect{44, 60, 32, 32};
  return o;
}

TEST(GlossyLobes, AreThoseOfMonteCarloWhenConverged) {
  for (const float alpha : {0.15f, 0.4f}) {
    for (const bool sky : {false, true}) {
      const Scene scene = glossy_scene(alpha, sky).scene;
      const Image expected = render(scene, options_for(Method::monte_carlo, 1024)).image;
      const RenderResult fields = render(scene, options_for(Method::hybrid, 1024));
      EXPECT_GT(fields.stats.rays_glossy_exact, 0u);
      EXPECT_GT(fields.stats.rays_glossy, 2 * fields.stats.rays_glossy_exact) << alpha;
      const ImageDifference d = compare_images(fields.image, expected);
      EXPECT_LE(d.rmse, 0.006) << alpha << " " << sky;
      EXPECT_LE(std::abs(d.bias), 0.0015) << alpha << " " << sky;
      EXPECT_LE(d.worst_block_rmse, 0.02) << alpha << " " << sky;
    }
  }
}

// What --check says of the maps' answers; and that it changes no picture.
TEST(GlossyLobes, AreComparedWithRays) {
  for (const float alpha : {0.15f, 0.4f}) {
    const Scene scene = glossy_scene(alpha, false).scene;
    RenderOptions o = options_for(Method::hybrid, 512);
    const Image plain = render(scene, o).image;
    o.check = true;
    const RenderResult checked = render(scene, o);
    EXPECT_EQ(plain.data, checked.image.data);
    const CheckedDifferences& lobes = checked.stats.checked(CheckedEstimate::lobes);
    EXPECT_GT(lobes.compared, 50u);
    EXPECT_GT(lobes.mean_difference(), 0.0);
    EXPECT_LT(lobes.mean_difference(), 0.15);
    EXPECT_LT(std::abs(lobes.bias()), 0.05);
  }
}

TEST(GlossyLobes, MapsLeftOutForMemoryAreToldAboutOnce) {
  const Scene scene = glossy_scene(0.15f, false).scene;
  RenderOptions o = options_for(Method::hybrid, 1);
  o.crop = Rect{16, 24, 16, 16};
  std::vector<std::string> warnings;
  RenderCallbacks callbacks;
  callbacks.warning = [&](const std::string& line) { warnings.push_back(line); };
  // Too few rays pay for maps: memory is not why there are none.
  o.field_memory = 1'000'000;
  o.leave_to_rays = true;
  EXPECT_EQ(render(scene, o, callbacks).stats.field_bytes_maps, 0u);
  o.leave_to_rays = false;
  for (const std::string& line : warnings) EXPECT_EQ(line.find("radiance maps"), std::string::npos) << line;
  o.lobe_samples = 1024;
  warnings.clear();
  o.field_memory = 0;
  EXPECT_GT(render(scene, o, callbacks).stats.field_bytes_maps, 0u);
  EXPECT_TRUE(warnings.empty()) << warnings.front();
  // Fields begin again with less, and maps are left out each time.
  o.field_memory = 200'000;
  const RenderResult r = render(scene, o, callbacks);
  EXPECT_GT(r.stats.field_restarts, 0u);
  EXPECT_EQ(r.stats.field_bytes_maps, 0u);
  const auto told = std::count_if(warnings.begin(), warnings.end(), [](const std::string& line) {
    return line.find("radiance maps of 1 object do not fit") != std::string::npos &&
           line.find("--field-memory") != std::string::npos;
  });
  EXPECT_EQ(told, 1);
}

// Only pictures of many glossy rays repay maps, whatever part of them is rendered; or they are made by request.
TEST(GlossyLobes, NeedManyRaysOrARequest) {
  constexpr int k_side = 1024;  // with 32 lobe samples a pixel as many rays as maps need
  static_assert(uint64_t(k_side) * k_side * 32 == LobeAnswerer::k_fewest_rays);
  const Scene scene = glossy_scene(0.3f, false, k_side).scene;
  const auto map_bytes = [&](int lobe_samples, bool leave_to_rays, int directions) {
    RenderOptions o = options_for(Method::hybrid, lobe_samples);
    o.leave_to_rays = leave_to_rays;
    o.directions = directions;
    o.crop = Rect{480, 640, 8, 8};
    return render(scene, o).stats.field_bytes_maps;
  };
  EXPECT_EQ(map_bytes(31, true, 0), 0u);
  EXPECT_GT(map_bytes(32, true, 0), 0u);
  EXPECT_GT(map_bytes(31, false, 0), 0u);
  EXPECT_GT(map_bytes(31, true, 32), 0u);
}

// Filtering removes more noise than its blur adds error.
TEST(GlossyLobes, FewSamplesAreNoWorseThanRays) {
  const Scene scene = glossy_scene(0.3f, false, 512).scene;
  const auto picture = [&](Method method, int lobe_samples) {
    RenderOptions o = options_for(method, lobe_samples);
    o.crop = Rect{220, 300, 64, 32};
    return render(scene, o);
  };
  // With the same camera rays, whose noise would mask that of the lobes.
  const Image expected = picture(Method::monte_carlo, 4096).image;
  const RenderResult fields = picture(Method::hybrid, 16);
  EXPECT_GT(fields.stats.rays_glossy_exact, 0u);
  EXPECT_LE(compare_images(fields.image, expected).rmse,
            compare_images(picture(Method::monte_carlo, 16).image, expected).rmse);
}

TEST(GlossyLobes, AtToleranceZeroAreMonteCarlo) {
  const Scene scene = glossy_scene(0.2f, true).scene;
  RenderOptions o = options_for(Method::hybrid, 8);
  o.tolerance = 0.0f;
  const RenderResult r = render(scene, o);
  EXPECT_EQ(r.image.data, render(scene, options_for(Method::monte_carlo, 8)).image.data);
  EXPECT_EQ(r.stats.rays_glossy_exact, r.stats.rays_glossy);
}

TEST(GlossyLobes, AreTheSameOnEveryMachine) {
  const Scene scene = glossy_scene(0.15f, false, 32).scene;
  RenderOptions o = options_for(Method::hybrid, 1024);
  o.isa = Isa::scalar;
  o.threads = 1;
  const RenderResult expected = render(scene, o);
  EXPECT_GT(expected.stats.rays_glossy_exact, 0u);  // the maps refused some rays
  EXPECT_GT(expected.stats.rays_glossy, 2 * expected.stats.rays_glossy_exact);
  for (const Isa isa : supported_isas()) {
    o.isa = isa;
    o.threads = 3;
    EXPECT_EQ(render(scene, o).image.data, expected.image.data) << isa_name(isa);
  }
  o.crop = Rect{5, 7, 9, 11};
  const Image part = render(scene, o).image;
  for (int y = 0; y < 11; ++y) {
    for (int x = 0; x < 9; ++x) {
      for (int c = 0; c < 3; ++c) EXPECT_EQ(part.pixel(x, y)[c], expected.image.pixel(x + 5, y + 7)[c]);
    }
  }
}

// Lobes narrower than the maps' texels are left to rays; the rougher the lobes, the more rays the maps answer.
TEST(GlossyLobes, SmoothOnesAreLeftToRays) {
  double last = 1.0;
  for (const float alpha : {0.001f, 0.03f, 0.1f, 0.3f}) {
    const Scene scene = glossy_scene(alpha, false, k_film).scene;
    const RenderResult r = render(scene, crop_options(Method::hybrid, 256));
    ASSERT_GT(r.stats.field_bytes_maps, 0u) << alpha;
    const double exact = double(r.stats.rays_glossy_exact) / double(r.stats.rays_glossy);
    EXPECT_LE(exact, 1.02 * last) << alpha;  // wider lobes meet slightly more of the object's ball
    last = exact;
    if (alpha > 0.001f) continue;
    EXPECT_LE(compare_images(r.image, render(scene, crop_options(Method::monte_carlo, 256)).image).rmse, 0.002);
  }
  EXPECT_LT(last, 0.2);
}

// From mirrors, left to rays, to rough metal, answered by maps: the picture changes without jumps.
TEST(GlossyLobes, ChangeGraduallyWithRoughness) {
  double last_bias = 0.0, last_exact = 1.0;
  for (float alpha = 0.02f; alpha < 1.0f; alpha *= 1.4f) {
    const Scene scene = glossy_scene(alpha, false, k_film).scene;
    const RenderResult fields = render(scene, crop_options(Method::hybrid, 512));
    ASSERT_GT(fields.stats.field_bytes_maps, 0u) << alpha;
    const Image expected = render(scene, crop_options(Method::monte_carlo, 512)).image;
    const ImageDifference d = compare_images(fields.image, expected);
    const double exact = double(fields.stats.rays_glossy_exact) / double(fields.stats.rays_glossy);
    EXPECT_LE(std::abs(d.bias - last_bias), 0.001) << alpha;
    EXPECT_LE(d.rmse, 0.01) << alpha;
    EXPECT_LE(std::abs(exact - last_exact), 0.4) << alpha;
    last_bias = d.bias;
    last_exact = exact;
  }
  EXPECT_LT(last_exact, 0.1);
}

// Bounces between objects and floor use maps, too.
TEST(GlossyLobes, HoldAtAnyDepth) {
  Scene scene = glossy_scene(0.3f, true, k_film).scene;
  for (const int max_depth : {4, -1}) {
    scene.integrator.max_depth = max_depth;
    const RenderResult fields = render(scene, crop_options(Method::hybrid, 1024));
    EXPECT_GT(fields.stats.field_bytes_maps, 0u);
    EXPECT_GT(fields.stats.rays_glossy, 2 * fields.stats.rays_glossy_exact) << max_depth;
    const RenderResult rays = render(scene, crop_options(Method::monte_carlo, 1024));
    const ImageDifference d = compare_images(fields.image, rays.image);
    EXPECT_LE(d.rmse, 0.02) << max_depth;
    EXPECT_LE(std::abs(d.bias), 0.003) << max_depth;
    // Light by more than one bounce is a substantial part.
    RenderOptions o = crop_options(Method::monte_carlo, 1024);
    o.max_depth = 3;
    EXPECT_GT(compare_images(rays.image, render(scene, o).image).bias, 0.01) << max_depth;
  }
}

// AOVs of what rays from the floor meet, and of the share of them that was traced.
TEST(GlossyLobes, LayersTellWhatIsReflected) {
  const Scene scene = glossy_scene(0.3f, false, 48).scene;
  RenderOptions o = options_for(Method::monte_carlo, 512);
  o.aovs = {"object", "reflected_object", "reflected_depth", "glossy_exact"};
  const Image traced = render(scene, o).image;
  o.method = Method::hybrid;
  const Image filtered = render(scene, o).image;
  int floor_pixels = 0, same_object = 0;
  double depth_traced = 0.0, depth_filtered = 0.0, exact = 0.0;
  for (int i = 0; i < 48 * 48; ++i) {
    const float* a = traced.pixel(i % 48, i / 48) + 3;
    const float* b = filtered.pixel(i % 48, i / 48) + 3;
    ASSERT_EQ(a[0], b[0]);
    if (a[0] != 2.0f) {  // not the floor: a diffuse surface, or a miss
      for (int c = 1; c < 4; ++c) EXPECT_EQ(b[c], 0.0f);
      continue;
    }
    ++floor_pixels;
    EXPECT_TRUE(a[1] == 0.0f || a[1] == 1.0f || a[1] == 3.0f) << a[1];  // a miss, the knot or the lamp
    EXPECT_EQ(a[3], 1.0f);
    same_object += a[1] == b[1];
    exact += b[3];
    if (!(a[2] > 0.0f && b[2] > 0.0f)) continue;  // too few rays hit anything
    depth_traced += a[2];
    depth_filtered += b[2];
  }
  ASSERT_GT(floor_pixels, 500);
  EXPECT_GT(double(same_object), 0.95 * floor_pixels);
  EXPECT_NEAR(depth_filtered / depth_traced, 1.0, 0.02);
  EXPECT_GT(exact, 0.0);
  EXPECT_LT(exact, 0.5 * floor_pixels);
}

// Shades patches by exact rays.
struct ExactShading {
  const Accel accel;
  const CameraSampler camera;
  const ShadowAnswerer exact;
  TransportContext context;

  explicit ExactShading(const Scene& scene, bool whole_scene = true, int max_depth = -1)
      : accel(scene),
        camera(scene.camera, scene.film),
        exact(scene, accel, shape_traits(scene), std::vector<Field*>(scene.shapes.size()), answering(whole_scene)),
        context(scene, accel, camera, exact, transport(max_depth)) {}

  static AnswererSettings answering(bool whole_scene) {
    AnswererSettings settings;
    settings.isa = resolve_isa(Isa::automatic);
    settings.whole_scene = whole_scene;
    return settings;
  }
  static TransportSettings transport(int max_depth) {
    TransportSettings settings;
    settings.isa = resolve_isa(Isa::automatic);
    settings.light_samples = k_patch_samples;
    settings.max_depth = max_depth;
    return settings;
  }
};

// A convex object in a white furnace sends albedo x radiance everywhere outside and, one-sided, nothing inside.
TEST(SurfaceRadiance, OfAConvexObjectInAFurnace) {
  SceneMaker m;
  const uint32_t clay = m.bsdf(BsdfKind::diffuse, Rgb(k_albedo, 0.4f, 0.3f));
  const uint32_t ball = m.instance(m.mesh(make_sphere({.around = 24, .along = 12})), clay, test::scaling({2, 1, 3}));
  m.light(EmitterKind::constant, Rgb(2.0f));
  const ExactShading shading(m.scene);
  SurfaceRadiance radiance(shading.context, ball, 0.1f);
  TestRandom random(4);
  const auto triangles = uint32_t(m.scene.shapes[0].mesh.triangles.size());
  EXPECT_GT(SurfaceRadiance::count_patches(m.scene, ball, 0.1f), uint64_t(triangles) * 4);
  double mean = 0.0;
  for (int i = 0; i < 1000; ++i) {
    float u = random.uniform(0.0f, 1.0f), v = random.uniform(0.0f, 1.0f);
    if (u + v > 1.0f) u = 1.0f - u, v = 1.0f - v;
    const uint32_t t = random.index(triangles);
    const SurfaceRadiance::Side sides[] = {radiance.side_at(t, u, v, false), radiance.side_at(t, u, v, true)};
    radiance.shade(sides);
    const Rgb front = radiance.radiance(sides[0]);
    // At most an eighth of the 16 stratified samples about a smooth normal lies below the facet.
    EXPECT_NEAR(front.x, 2.0f * k_albedo, 0.13f);
    mean += front.x / 1000.0;
    EXPECT_NEAR(front.y / front.x, 0.8f, 1e-5f);
    EXPECT_EQ(radiance.radiance(sides[1]), Rgb(0.0f));
  }
  EXPECT_NEAR(mean, 2.0f * k_albedo, 0.02);
}

// Every point of a triangle belongs to the patch with the nearest centre.
TEST(SurfaceRadiance, PatchesTileTheirTriangle) {
  SceneMaker m;
  const uint32_t clay = m.bsdf(BsdfKind::diffuse, Rgb(1.0f));
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}};
  const uint32_t plate = m.instance(m.mesh(mesh), clay, Affine(1.0f));
  // The irradiance of this point light falls with the distance from the corner at the origin.
  m.light(EmitterKind::point, Rgb(1.0f), {0, 0, 0.5f});
  const ExactShading shading(m.scene);
  const float patch = 0.05f;
  SurfaceRadiance radiance(shading.context, plate, patch);
  const auto analytic = [](float u, float v) {
    const float r2 = u * u + v * v + 0.25f;
    return 0.5f / (r2 * std::sqrt(r2)) / k_pi;
  };
  for (float u = 0.0f; u <= 1.0f; u += 0.01f) {
    for (float v = 0.0f; u + v <= 1.0f; v += 0.01f) {
      // The point lies within a patch's edge of the centre, and the gradient is below 2.5 times the value there.
      const float expected = analytic(u, v);
      const SurfaceRadiance::Side side[] = {radiance.side_at(0, u, v, false)};
      radiance.shade(side);
      EXPECT_NEAR(radiance.radiance(side[0]).x, expected, patch * 2.5f * expected) << u << " " << v;
    }
  }
}

// With more objects than can be tested one by one, threads and windows decide which patches are shaded together; their
// radiance must not depend on that.
TEST(SurfaceRadiance, DoesNotDependOnWhatIsShadedBesideIt) {
  SceneMaker m;
  const uint32_t clay = m.bsdf(BsdfKind::diffuse, Rgb(k_albedo));
  const uint32_t globe = m.instance(m.mesh(make_sphere({.around = 24, .along = 12})), clay, Affine(1.0f));
  const uint32_t bead = m.shape(ShapeKind::sphere);
  const Affine floor(Vec3(8, 0, 0), Vec3(0, 8, 0), Vec3(0, 0, 1), Vec3(0, 0, -1.5f));
  m.instance(m.shape(ShapeKind::rectangle), clay, floor);
  for (int i = 0; i < 40; ++i) {  // a ring between the globe and the lamp
    const float angle = 2.0f * k_pi * float(i) / 40.0f;
    const Vec3 at(0.6f * std::cos(angle), 0.6f * std::sin(angle), 1.6f);
    m.instance(bead, clay, Affine(Vec3(0.02f, 0, 0), Vec3(0, 0.02f, 0), Vec3(0, 0, 0.02f), at));
  }
  const Affine lamp(Vec3(0.3f, 0, 0), Vec3(0, 0.3f, 0), Vec3(0, 0, 0.3f), Vec3(0, 0, 6));
  m.area_light(m.instance(bead, clay, lamp), Rgb(100.0f));
  for (const bool whole_scene : {false, true}) {
    // Paths go on to the floor, nearly all of which sees the whole lamp.
    const ExactShading shading(m.scene, whole_scene, 4);
    SurfaceRadiance alone(shading.context, globe, 0.2f), together(shading.context, globe, 0.2f);
    std::vector<SurfaceRadiance::Side> sides;
    const auto triangles = uint32_t(m.scene.shapes[0].mesh.triangles.size());
    for (uint32_t t = 0; t < triangles; ++t) sides.push_back(together.side_at(t, 0.3f, 0.3f, false));
    together.shade(sides);
    int different = 0;
    for (const SurfaceRadiance::Side side : sides) {
      alone.shade({&side, 1});
      different += alone.radiance(side) != together.radiance(side);
    }
    if (whole_scene) {
      EXPECT_EQ(different, 0);
    } else {
      EXPECT_GT(different, 0);  // sampled when shaded together, in closed form when alone
    }
  }
}

// A patch shows its texture's mean over it: in a furnace, one colour within a check and a mixture across the checks'
// edges.
TEST(SurfaceRadiance, PatchesShowTheMeanOfTheirTexture) {
  SceneMaker m;
  const uint32_t tiles = m.bsdf(BsdfKind::diffuse, Rgb(1.0f));
  Texture& checks = m.scene.textures[m.scene.bsdfs[tiles].reflectance];
  checks.kind = TextureKind::checkerboard;
  checks.color0 = Rgb(0.2f);
  checks.color1 = Rgb(0.8f);
  TriangleMesh mesh;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.texcoords = {{0, 0}, {2, 0}, {0, 2}};  // checks of width 1 / 4
  mesh.triangles = {{0, 1, 2}};
  const uint32_t plate = m.instance(m.mesh(mesh), tiles, Affine(1.0f));
  m.light(EmitterKind::constant, Rgb(1.0f));
  EXPECT_TRUE(SurfaceRadiance::suits(m.scene, plate));
  const ExactShading shading(m.scene);
  SurfaceRadiance radiance(shading.context, plate, 0.1f);
  TestRandom random(6);
  double mean = 0.0;
  int dark = 0, light = 0, mixed = 0;
  for (int i = 0; i < 4000; ++i) {
    float u = random.uniform(0.0f, 1.0f), v = random.uniform(0.0f, 1.0f);
    if (u + v > 1.0f) u = 1.0f - u, v = 1.0f - v;
    const SurfaceRadiance::Side side[] = {radiance.side_at(0, u, v, false)};
    radiance.shade(side);
    const float value = radiance.radiance(side[0]).x;
    const float colour = evaluate_texture(m.scene, m.scene.bsdfs[tiles].reflectance, {2 * u, 2 * v}).x;
    mean += (value - colour) / 4000.0;
    (std::abs(value - 0.2f) < 1e-4f ? dark : std::abs(value - 0.8f) < 1e-4f ? light : mixed) += 1;
    // A patch's edges are at most 0.14 long: farther than that from a check's edge nothing is mixed.
    const auto from_edge = [](float x) { return std::abs(4.0f * x - std::round(4.0f * x)) / 4.0f; };
    if (std::min(from_edge(u), from_edge(v)) > 0.1f) {
      EXPECT_NEAR(value, colour, 1e-4f) << u << " " << v;
    }
  }
  EXPECT_NEAR(mean, 0.0, 0.01);
  EXPECT_GT(dark, 500);
  EXPECT_GT(light, 500);
  EXPECT_GT(mixed, 100);
}

// The sum over any rectangle is that of its texels.
TEST(RadianceTiles, SumsAreThoseOfTheirTexels) {
  CoverageTiles tiles(32, 64, nullptr, TilePayload::radiance);
  TestRandom random(9);
  const int side = tiles.lines();
  std::vector<Rgb> plane(size_t(side) * side, Rgb(0.0f));
  const uint32_t direction = 77;
  for (uint32_t slot = 0; slot < tiles.slot_count(); ++slot) {
    const CoverageTiles::Place place = tiles.place(slot);
    if (place.direction != direction) continue;
    TileLines lines(CoverageTiles::k_lines_per_tile);
    std::vector<Rgb> colours(CoverageTiles::k_lines_per_tile, Rgb(0.0f));
    for (int i = 0; i < int(lines.size()); ++i) {
      if (random.uniform(0.0f, 1.0f) < 0.5f) continue;
      lines[size_t(i)] = uint16_t(1 + random.index(1000));
      colours[size_t(i)] = Rgb(random.log_uniform(1e-3f, 1e3f), random.uniform(0.0f, 1.0f), 1.0f);
      plane[size_t(place.y + i / 32) * size_t(side) + size_t(place.x + i % 32)] = colours[size_t(i)];
    }
    ASSERT_TRUE(tiles.claim(slot));
    ASSERT_TRUE(tiles.finish(slot, lines, colours));
  }
  for (int k = 0; k < 300; ++k) {
    scalar::PlaneRect<float> r;
    const float w = random.log_uniform(0.1f, 60.0f), h = random.log_uniform(0.1f, 60.0f);
    r.x0 = random.uniform(0.0f, float(side) - w), r.x1 = r.x0 + w;
    r.y0 = random.uniform(0.0f, float(side) - h), r.y1 = r.y0 + h;
    double expected[3] = {};
    for (int y = int(r.y0); y < side && float(y) < r.y1; ++y) {
      for (int x = int(r.x0); x < side && float(x) < r.x1; ++x) {
        const double part = double(std::min(r.x1, float(x + 1)) - std::max(r.x0, float(x))) *
                            double(std::min(r.y1, float(y + 1)) - std::max(r.y0, float(y)));
        for (int c = 0; c < 3; ++c) expected[c] += part * double(plane[size_t(y) * size_t(side) + size_t(x)][c]);
      }
    }
    const auto sum = scalar::sum_radiance_area<float>(tiles.view(), int32_t(direction), r, true);
    // Differences of sums of up to 1024 texels, each up to 1000.
    EXPECT_NEAR(sum.red, expected[0], 1e-4 * expected[0] + 1.0) << w << " " << h;
    EXPECT_NEAR(sum.green, expected[1], 1e-4 * expected[1] + 1e-3);
    EXPECT_NEAR(sum.blue, expected[2], 1e-4 * expected[2] + 1e-3);
  }
}

}  // namespace
}  // namespace fieldtrace
