// Scenes with very large and very small numbers. Within the limits of core/loader/scene_limits.h they render as at any
// other scale; beyond them the loader refuses them, naming file and line. Embree never receives input that it aborts
// on.

#include "core/loader/scene_limits.h"

#include <cmath>
#include <cstdio>

#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_procedural.h"
#include "hybrid/render/render.h"
#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}
std::string triple(double x, double y, double z) { return number(x) + " " + number(y) + " " + number(z); }
std::string element(const char* tag, const char* name, const std::string& value) {
  return std::string("<") + tag + " name='" + name + "' value='" + value + "'/>";
}
std::string placed(const std::string& steps) { return "<transform name='to_world'>" + steps + "</transform>"; }
std::string scaled(double factor) { return "<scale value='" + number(factor) + "'/>"; }

class SceneLimits : public SceneFiles {
 protected:
  // A knot over a floor under a spherical light. All lengths are multiples of `unit`; the knot's vertices are scaled by
  // `vertices`, which its transform undoes.
  std::string knot_scene(double unit, double vertices, const std::string& more = {}) {
    TriangleMesh mesh = make_knot({.along = 256, .around = 16});
    for (Vec3& p : mesh.positions) p *= float(vertices);
    save_ply(path("knot.ply"), mesh);
    const double u = unit;
    return "<integrator type='path'>" + element("integer", "max_depth", "3") +
           "</integrator><sensor type='perspective'>" + element("float", "fov", "40") +
           element("float", "near_clip", number(.01 * u)) + element("float", "far_clip", number(1e4 * u)) +
           placed("<lookat origin='" + triple(0, -4 * u, 2 * u) + "' target='" + triple(0, 0, .5 * u) +
                  "' up='0 0 1'/>") +
           "<film type='hdrfilm'>" + element("integer", "width", "32") + element("integer", "height", "32") +
           "<rfilter type='box'/></film></sensor><shape type='rectangle'>" + placed(scaled(4 * u)) +
           "</shape><shape type='ply'>" + element("string", "filename", "knot.ply") +
           placed(scaled(u / vertices) + "<translate z='" + number(u) + "'/>") + "</shape><shape type='sphere'>" +
           "<point name='center' value='" + triple(1.5 * u, -u, 4.5 * u) + "'/>" +
           element("float", "radius", number(.5 * u)) + "<emitter type='area'>" + element("rgb", "radiance", "100") +
           "</emitter></shape>" + more;
  }

  Image render_scene(const std::string& body, Method method) {
    RenderOptions options;
    options.method = method;
    options.spp = 2;
    options.light_samples = 16;
    return render(load(body), options).image;
  }
};

double mean(const Image& image) {
  double sum = 0;
  for (const float v : image.data) sum += double(v);
  return sum / double(image.data.size());
}

// Scaling by a power of two changes no digit, so the images agree bit for bit.
TEST_F(SceneLimits, PicturesDoNotDependOnTheScale) {
  for (const Method method : {Method::monte_carlo, Method::hybrid}) {
    const Image expected = render_scene(knot_scene(1, 1), method);
    ASSERT_GT(mean(expected), 0.05);
    const struct {
      int unit, vertices;  // exponents of 2
    } cases[] = {
        {37, 0},   {-37, 0},              // the whole scene, by its transforms
        {37, 37},  {-27, -27},            // by its vertices
        {0, 38},   {0, -28},              // the vertices alone, undone by their transform
        {-30, 11}, {30, -11},  {-20, 20}  // both
    };
    for (const auto& [unit, vertices] : cases) {
      const Image image = render_scene(knot_scene(std::exp2(unit), std::exp2(vertices)), method);
      EXPECT_EQ(image.data, expected.data) << "2^" << unit << ", vertices 2^" << vertices;
    }
  }
}

// Every scale either renders correctly or is refused: no crash and no black image in between.
TEST_F(SceneLimits, EveryScaleIsRightOrRefused) {
  const Image expected = render_scene(knot_scene(1, 1), Method::monte_carlo);
  int right = 0, refused = 0;
  for (int e = -126; e <= 124; ++e) {
    for (const int vertices : {0, e}) {
      try {
        const Image image = render_scene(knot_scene(std::exp2(e), std::exp2(vertices)), Method::monte_carlo);
        EXPECT_EQ(image.data, expected.data) << "2^" << e << ", vertices 2^" << vertices;
        ++right;
      } catch (const Error& error) {
        EXPECT_EQ(std::string(error.what()).find(path("scene.xml:")), 0u) << error.what();
        ++refused;
      }
    }
  }
  EXPECT_GT(right, 140);
  EXPECT_GT(refused, 250);
}

// The reference for a transform that nearly flattens is a mesh with that transform baked into its vertices.
TEST_F(SceneLimits, TheFlattestTransformIsRight) {
  const auto scene = [&](bool by_vertices, double squash) {
    TriangleMesh mesh = make_knot({.along = 256, .around = 16});
    const double c = std::cos(0.5), s = std::sin(0.5);
    const DAffine turn(DVec3(c, 0, -s), DVec3(0, 1, 0), DVec3(s, 0, c), DVec3(0.0));
    if (by_vertices) {
      mesh.normals.clear();
      for (Vec3& p : mesh.positions) {
        DVec3 q = turn[0] * double(p.x) + turn[1] * double(p.y) + turn[2] * double(p.z);
        q.x *= squash;
        p = Vec3(turn[0] * q.x + turn[1] * q.y + turn[2] * q.z);
      }
    }
    const std::string body = knot_scene(1, 1);
    save_ply(path("knot.ply"), mesh);
    const std::string turned = "<rotate y='1' angle='" + number(0.5 * 180 / 3.14159265358979323846) + "'/>";
    const std::string steps = turned + "<scale x='" + number(squash) + "'/>" + turned;
    const size_t at = body.find("<scale value='1'/><translate");
    return by_vertices ? body : body.substr(0, at) + steps + body.substr(at);
  };
  // This transform's determinant is squash, and the sum of its terms' magnitudes 2 (sin .5 cos .5)^2.
  const double squash = 1.05 * k_least_determinant * std::sin(1.0) * std::sin(1.0) / 2;
  const Image image = render_scene(scene(false, squash), Method::monte_carlo);
  const Image oracle = render_scene(scene(true, squash), Method::monte_carlo);
  size_t differing = 0;
  for (size_t i = 0; i < image.data.size(); ++i) differing += std::abs(image.data[i] - oracle.data[i]) > 0.02f;
  // A body as thin as 2^-15 of its width is seen edge-on as a strip: a few pixels at its rim differ.
  EXPECT_LT(double(differing), 0.01 * double(image.data.size()));
  EXPECT_NE(error_of(scene(false, squash / 1.1)).find("flattens"), std::string::npos);
}

// Scales along the world's axes after a rotation cancel nothing: the reference is a mesh with the transform baked in.
TEST_F(SceneLimits, NeedlesAreRight) {
  const auto scene = [&](bool by_vertices) {
    TriangleMesh mesh = make_knot({.along = 256, .around = 16});
    if (by_vertices) {
      mesh.normals.clear();
      for (Vec3& p : mesh.positions) {
        // 60 degrees about (1, 1, 1)
        const DVec3 q(2 * p.x - p.y + 2 * p.z, 2 * p.x + 2 * p.y - p.z, -p.x + 2 * p.y + 2 * p.z);
        p = Vec3(q * DVec3(1, 3e-3, 3e-3) / 3.0);
      }
    }
    const std::string body = knot_scene(1, 1);
    save_ply(path("knot.ply"), mesh);
    const size_t at = body.find("<scale value='1'/><translate");
    const std::string steps = "<rotate x='1' y='1' z='1' angle='60'/><scale y='.003' z='.003'/>";
    return by_vertices ? body : body.substr(0, at) + steps + body.substr(at);
  };
  const Image image = render_scene(scene(false), Method::monte_carlo);
  const Image oracle = render_scene(scene(true), Method::monte_carlo);
  size_t differing = 0;
  for (size_t i = 0; i < image.data.size(); ++i) differing += std::abs(image.data[i] - oracle.data[i]) > 0.02f;
  EXPECT_EQ(differing, 0u);
}

// A ball does not change by rotation before it is flattened. Embree transforms the rays that reach our own
// intersections in single precision, so what spoils meshes spoils balls.
TEST_F(SceneLimits, FlattenedSpheresAreRightOrRefused) {
  const auto scene = [&](const std::string& before, const char* z, const std::string& after) {
    const std::string body = knot_scene(1, 1), start = "<shape type='ply'>" + element("string", "filename", "knot.ply");
    const size_t at = body.find(start), end = body.find("</transform>", at) + std::string("</transform>").size();
    const std::string steps = before + "<scale z='" + z + "'/>" + after + "<translate z='1'/>";
    return body.substr(0, at) + "<shape type='sphere'>" + placed(steps) + body.substr(end);
  };
  const std::string turn = "<rotate x='1' y='.3' z='.5' angle='30'/>";
  const Image image = render_scene(scene(turn, "1e-3", ""), Method::monte_carlo);
  const Image oracle = render_scene(scene("", "1e-3", ""), Method::monte_carlo);
  ASSERT_NE(oracle.data, render_scene(scene("<scale x='.9'/>", "1e-3", ""), Method::monte_carlo).data);
  for (size_t i = 0; i < image.data.size(); ++i) ASSERT_NEAR(image.data[i], oracle.data[i], 0.001f) << i;
  const std::string grows = error_of(scene(turn, "1e-5", ""));
  EXPECT_NE(grows.find("more than 3.3e+04; scale before rotating"), std::string::npos) << grows;
  const std::string cancels = error_of(scene(turn, "1e-5", "<rotate x='1' angle='20'/>"));
  EXPECT_NE(cancels.find("less than 6.1e-05"), std::string::npos) << cancels;
  EXPECT_NE(cancels.find("transform the mesh's vertices beforehand"), std::string::npos) << cancels;
  EXPECT_EQ(error_of(scene("", "1e-5", "")), "");
}

struct Extreme {
  const char* name;
  const char* body;  // starts in line 2 of scene.xml
  const char* where;
  const char* what;
};
void PrintTo(const Extreme& extreme, std::ostream* out) { *out << extreme.name; }

constexpr Extreme k_extremes[] = {
    {"LensFocusedFarAway",
     "<sensor type='thinlens'><float name='aperture_radius' value='.1'/>\n<float name='focus_distance' "
     "value='1e20'/></sensor>",
     "scene.xml:3: ", "focused at 1e+20"},
    {"LensFocusedByItsFarPlane",
     "<sensor type='thinlens'><float name='aperture_radius' value='.1'/>\n<float name='far_clip' "
     "value='1e20'/></sensor>",
     "scene.xml:3: ", "focused at 1e+20, its far_clip"},
    {"LensFocusedOnItself",
     "<sensor type='thinlens'><float name='aperture_radius' value='.1'/>\n<float name='focus_distance' "
     "value='1e-30'/></sensor>",
     "scene.xml:3: ", "focused at 1e-30"},
    {"WideLens",
     "<sensor type='thinlens'><float name='focus_distance' value='1'/>\n<float name='aperture_radius' "
     "value='1e20'/></sensor>",
     "scene.xml:3: ", "'aperture_radius' is 1e+20"},
    {"LensFocusedTooNear",
     "<sensor type='thinlens'><float name='focus_distance' value='1e-10'/>\n<float name='aperture_radius' "
     "value='1e10'/></sensor>",
     "scene.xml:3: ", "the camera's rays start as far as 1e+18"},
    {"FarNearPlane",
     "<sensor type='perspective'>\n<float name='near_clip' value='1e20'/><float name='far_clip' "
     "value='1e21'/></sensor>",
     "scene.xml:3: ", "the camera's rays start as far as"},
    {"PrincipalPoint", "<sensor type='perspective'>\n<float name='principal_point_offset_x' value='1e30'/></sensor>",
     "scene.xml:3: ", "'principal_point_offset_x' is 1e+30"},
    {"WideGaussian",
     "<sensor type='perspective'><film type='hdrfilm'><rfilter type='gaussian'>\n<float name='stddev' "
     "value='1e30'/></rfilter></film></sensor>",
     "scene.xml:3: ", "'stddev' is 1e+30"},
    {"WideTent",
     "<sensor type='perspective'><film type='hdrfilm'><rfilter type='tent'>\n<float name='radius' "
     "value='1e30'/></rfilter></film></sensor>",
     "scene.xml:3: ", "'radius' is 1e+30"},
    {"FarCamera",
     "<shape type='cube'/><sensor type='perspective'>\n<transform name='to_world'><translate "
     "x='1e19'/></transform></sensor>",
     "scene.xml:3: ", "the camera reaches to the coordinate 1e+19"},
    {"FarPointLight",
     "<shape type='cube'/>\n<emitter type='point'>\n<point name='position' value='0 1e19 0'/></emitter>",
     "scene.xml:4: ", "the light reaches to the coordinate 1e+19"},
    {"FarAreaLight",
     "<shape type='cube'/>\n<shape type='sphere'><point name='center' value='1e19 0 0'/><emitter type='area'/></shape>",
     "scene.xml:3: ", "the shape reaches to the coordinate"},
    {"LargeScale", "<shape type='cube'>\n<transform name='to_world'><scale value='1e18'/></transform></shape>",
     "scene.xml:3: ", "the shape reaches to the coordinate 1e+18"},
    {"SmallScale", "<shape type='cube'>\n<transform name='to_world'><scale value='1e-15'/></transform></shape>",
     "scene.xml:3: ", "the transform scales by 1e-15"},
    {"SmallestScale", "<shape type='cube'>\n<transform name='to_world'><scale value='1e-20'/></transform></shape>",
     "scene.xml:3: ", "the transform scales by 1e-20"},
    {"ThinScale", "<shape type='cube'>\n<transform name='to_world'><scale y='1e-18'/></transform></shape>",
     "scene.xml:3: ", "the transform scales by 1e-18"},
    {"NearlySingular",
     "<shape type='cube'>\n<transform name='to_world'><matrix value='1 1 0 1 1.000000001 0 0 0 "
     "1'/></transform></shape>",
     "scene.xml:3: ", "all but flattens the shape"},
    {"SmallInstance",
     "<shape type='shapegroup' id='g'><shape type='cube'>\n<transform name='to_world'><scale "
     "value='1e-8'/></transform></shape></shape><shape type='instance'><ref id='g'/>\n<transform "
     "name='to_world'><scale value='1e-8'/></transform></shape>",
     "scene.xml:4: ", "the transform scales by 1e-16"},
    {"SmallVertices", "<shape type='obj'>\n<string name='filename' value='small.obj'/></shape>",
     "scene.xml:2: ", "the shape has a size of"},
    {"SmallShapeInALargeScene",
     "<shape type='rectangle'><transform name='to_world'><scale value='1e12'/></transform></shape>\n<shape "
     "type='cube'><transform name='to_world'><scale value='1e-12'/></transform></shape><sensor "
     "type='perspective'/>",
     "scene.xml:3: ", "across in this shape's own units"},
    {"SmallScene",
     "<shape type='cube'><transform name='to_world'><scale value='2.5e-13'/></transform></shape><sensor "
     "type='perspective'><float name='near_clip' value='1e-15'/></sensor>",
     "scene.xml:1: ", "the whole scene is only"},
};

class ExtremeScene : public SceneFiles, public testing::WithParamInterface<Extreme> {};

TEST_P(ExtremeScene, IsRefusedByFileAndLine) {
  write("small.obj", "v 0 0 0\nv 1e-10 0 0\nv 0 1e-10 1e-10\nf 1 2 3\n");
  const std::string message = error_of(GetParam().body);
  EXPECT_EQ(message.find(path(GetParam().where)), 0u) << message;
  EXPECT_NE(message.find(GetParam().what), std::string::npos) << message;
}

INSTANTIATE_TEST_SUITE_P(SceneLimits, ExtremeScene, testing::ValuesIn(k_extremes),
                         [](const auto& extreme) { return std::string(extreme.param.name); });

TEST_F(SceneLimits, HugeTrianglesBesideTheCameraAreWarnedOf) {
  const auto floor = [&](double size) {
    return "<sensor type='perspective'>" + placed("<translate z='4'/>") + "</sensor><shape type='cube'/>\n" +
           "<shape type='rectangle'>" + placed(scaled(size)) + "</shape>";
  };
  // The rectangle's diagonal is 2^1.5 times that size, and the camera is 4 above the floor.
  const double limit = k_blurred_triangle * 4 / std::sqrt(8.0);
  load(floor(limit * 0.999));
  EXPECT_TRUE(warnings.empty()) << warnings[0];
  load(floor(limit * 1.001));
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_TRUE(warned(path("scene.xml:3: ") + "a triangle of this shape is ")) << warnings[0];
  strict = true;
  EXPECT_EQ(error_of(floor(limit * 0.999)), "");
  EXPECT_EQ(error_of(floor(limit * 1.001)).find(path("scene.xml:3: ") + "a triangle of this shape is "), 0u);
  // Seen from a distance as large as itself, the same rectangle is sharp.
  load("<sensor type='perspective'/>" + std::string("<shape type='rectangle'>") +
       placed(scaled(1e8) + "<translate z='1e8'/>") + "</shape>");
  EXPECT_TRUE(warnings.empty()) << warnings[0];
}

// Cameras just within the limits produce rays that Embree accepts, and render the scene.
TEST_F(SceneLimits, CamerasWithinTheLimitsSee) {
  const std::string world =
      "<emitter type='constant'/><shape type='sphere'><point name='center' "
      "value='0 0 20'/><float name='radius' value='3'/></shape>";
  const std::string film = "<film type='hdrfilm'>" + element("integer", "width", "16") +
                           element("integer", "height", "16") + "<rfilter type='box'/></film>";
  const auto lens = [&](double aperture, double focus) {
    return "<sensor type='thinlens'>" + element("float", "aperture_radius", number(aperture)) +
           element("float", "focus_distance", number(focus)) + film + "</sensor>";
  };
  const auto pinhole = [&](const std::string& more) {
    return "<sensor type='perspective'>" + film + more + "</sensor>";
  };
  const auto blurred = [&](const std::string& filter) {
    return "<sensor type='perspective'><film type='hdrfilm'>" + element("integer", "width", "16") +
           element("integer", "height", "16") + "<rfilter type='" + filter + "</rfilter></film></sensor>";
  };
  const std::string cameras[] = {
      lens(0.1, 0x1p40),
      lens(0x1p40 * 0.99, 0x1p40),
      lens(0.1, 0x1p-40),
      lens(0x1p-100, 1),
      pinhole(element("float", "near_clip", "9e11") + element("float", "far_clip", "1e38")),
      pinhole(element("float", "near_clip", "1e-38")),
      pinhole(element("float", "fov", "179.99999")),
      pinhole(element("float", "fov", "1e-30")),
      pinhole(element("float", "principal_point_offset_x", "256")),
      pinhole(placed("<translate x='1.09e12'/>")),
      blurred("gaussian'>" + element("float", "stddev", "16384")),
      blurred("gaussian'>" + element("float", "stddev", "1e-38")),
      blurred("tent'>" + element("float", "radius", "65536")),
  };
  for (const std::string& camera : cameras) {
    const Image image = render_scene(world + camera, Method::hybrid);
    // The sky is white and the shapes are grey, so every valid pixel lies between black and white.
    for (const float v : image.data) ASSERT_TRUE(v >= 0.0f && v <= 1.25f) << camera << ": " << v;
    EXPECT_GT(mean(image), 0.02) << camera;
  }
}

}  // namespace
}  // namespace fieldtrace
