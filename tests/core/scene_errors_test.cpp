// Errors of the scene loader: every message names the file and the line.

#include <cmath>
#include <random>

#include "tests/support/scene_test_files.h"

namespace fieldtrace {
namespace {

using SceneErrors = SceneFiles;

struct BadScene {
  const char* name;
  const char* body;   // starts in line 2 of scene.xml
  const char* where;  // how the message starts, after the folder
  const char* what;   // what the message contains
};

// GoogleTest prints this instead of the bytes.
void PrintTo(const BadScene& bad, std::ostream* out) { *out << bad.name; }

constexpr BadScene k_bad_scenes[] = {
    // numbers and values
    {"NotANumber", "<shape type='sphere'>\n<float name='radius' value='1x'/></shape>",
     "scene.xml:3: ", "'1x' is not a number"},
    {"NaN", "<shape type='sphere'><float name='radius' value='nan'/></shape>", "scene.xml:2: ", "not a finite number"},
    {"TooLarge", "<shape type='sphere'><float name='radius' value='1e39'/></shape>", "scene.xml:2: ", "too large"},
    {"FarTooLarge", "<shape type='sphere'><float name='radius' value='1e999'/></shape>", "scene.xml:2: ", "too large"},
    {"NegativeRadius", "<shape type='sphere'><float name='radius' value='-1'/></shape>",
     "scene.xml:2: ", "'radius' is -1 but must be greater than 0"},
    {"RadiusThatRoundsToZero", "<shape type='sphere'><float name='radius' value='1e-60'/></shape>",
     "scene.xml:2: ", "must be greater than 0"},
    {"WrongType", "<shape type='sphere'><string name='radius' value='1'/></shape>",
     "scene.xml:2: ", "'radius' is a <string> but must be a <float>"},
    {"FractionalInteger", "<integrator type='path'><integer name='max_depth' value='2.5'/></integrator>",
     "scene.xml:2: ", "must be a whole number"},
    {"DepthBelowMinusOne", "<integrator type='path'><integer name='max_depth' value='-2'/></integrator>",
     "scene.xml:2: ", "between -1 and"},
    {"NotABoolean", "<shape type='cube'><boolean name='flip_normals' value='yes'/></shape>",
     "scene.xml:2: ", "must be true or false"},
    {"PropertyTwice", "<shape type='sphere'><float name='radius' value='1'/>\n<float name='radius' value='2'/></shape>",
     "scene.xml:3: ", "'radius' is given twice"},
    {"MissingValue", "<shape type='sphere'><float name='radius'/></shape>",
     "scene.xml:2: ", "lacks its attribute 'value'"},
    {"PointWithTwoNumbers", "<shape type='sphere'><point name='center' value='1 2'/></shape>",
     "scene.xml:2: ", "needs 3 numbers, not 2"},
    {"PointWithoutZ", "<shape type='sphere'><point name='center' x='1' y='2'/></shape>",
     "scene.xml:2: ", "lacks its attribute 'z'"},
    {"TwoNumberColour", "<emitter type='constant'><rgb name='radiance' value='1 2'/></emitter>",
     "scene.xml:2: ", "one or three numbers"},
    {"BadHexColour", "<emitter type='constant'><rgb name='radiance' value='#12345g'/></emitter>",
     "scene.xml:2: ", "#rrggbb"},
    {"NegativeRadiance", "<emitter type='constant'><rgb name='radiance' value='-1'/></emitter>",
     "scene.xml:2: ", "'radiance' must not be negative"},
    {"ReflectanceAboveOne",
     "<shape type='cube'><bsdf type='diffuse'>\n<rgb name='reflectance' value='1.5'/></bsdf></shape>",
     "scene.xml:3: ", "'reflectance' must lie in [0, 1]"},
    {"WavelengthsFallBack", "<emitter type='constant'><spectrum name='radiance' value='500:1 400:2'/></emitter>",
     "scene.xml:2: ", "must increase"},
    {"SpectrumAboveOne",
     "<shape type='cube'><bsdf type='diffuse'><spectrum name='reflectance' value='400:2 700:2'/></bsdf></shape>",
     "scene.xml:2: ", "'reflectance' must lie in [0, 1]"},
    {"TooSmallAndMalformed", "<shape type='sphere'><float name='radius' value='1e-999junk'/></shape>",
     "scene.xml:2: ", "'1e-999junk' is not a number"},
    {"TooLargeInTenths", "<shape type='sphere'><float name='radius' value='1e999e-1'/></shape>",
     "scene.xml:2: ", "'1e999e-1' is not a number"},
    {"SpectrumFile", "<emitter type='constant'><spectrum name='radiance' filename='a.spd'/></emitter>",
     "scene.xml:2: ", "not available yet"},
    // transforms
    {"SingularScale", "<shape type='cube'>\n<transform name='to_world'><scale x='0'/></transform></shape>",
     "scene.xml:3: ", "singular"},
    {"SingularMatrix",
     "<shape type='cube'><transform name='to_world'><matrix value='1 2 3 2 4 6 1 1 1'/></transform></shape>",
     "scene.xml:2: ", "singular"},
    {"InverseOverflows",
     "<shape type='cube'><transform name='to_world'><scale value='1e-20'/><scale value='1e-19'/></transform></shape>",
     "scene.xml:2: ", "singular"},
    {"TransformOverflows",
     "<shape type='cube'><transform name='to_world'><scale value='1e30'/><scale value='1e30'/></transform></shape>",
     "scene.xml:2: ", "beyond single precision"},
    {"RotationWithoutAxis", "<shape type='cube'><transform name='to_world'>\n<rotate angle='3'/></transform></shape>",
     "scene.xml:3: ", "needs an axis"},
    {"RotationWithoutAngle", "<shape type='cube'><transform name='to_world'><rotate x='3'/></transform></shape>",
     "scene.xml:2: ", "'angle'"},
    {"TenNumberMatrix",
     "<shape type='cube'><transform name='to_world'><matrix value='1 2 3 4 5 6 7 8 9 10'/></transform></shape>",
     "scene.xml:2: ", "16 or 9 numbers, not 10"},
    {"ProjectiveMatrix",
     "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 "
     "1'/></transform></shape>",
     "scene.xml:2: ", "0 0 0 1"},
    {"LookAtItself",
     "<sensor type='perspective'><transform name='to_world'><lookat origin='1 1 1' target='1 1 1' up='0 0 "
     "1'/></transform></sensor>",
     "scene.xml:2: ", "target at its origin"},
    {"LookAlongUp",
     "<sensor type='perspective'><transform name='to_world'><lookat origin='0 0 0' target='0 0 5' up='0 0 "
     "1'/></transform></sensor>",
     "scene.xml:2: ", "up vector"},
    {"ValueAndXyz", "<shape type='cube'><transform name='to_world'><scale value='2' x='1'/></transform></shape>",
     "scene.xml:2: ", "both value and x, y, z"},
    // parameters, references, includes
    {"UndefinedParameter", "\n<shape type='$kind'/>", "scene.xml:3: ", "undefined parameter $kind"},
    {"UnknownReference", "<shape type='cube'>\n<ref id='m'/></shape>", "scene.xml:3: ", "no object has the id 'm'"},
    {"IdTwice", "<bsdf type='diffuse' id='m'/>\n<bsdf type='diffuse' id='m'/>",
     "scene.xml:3: ", "the id 'm' is already given in line 2"},
    {"CyclicMaterial", "<bsdf type='twosided' id='m'><ref id='m'/></bsdf><shape type='cube'><ref id='m'/></shape>",
     "scene.xml:2: ", "contains itself"},
    {"MissingInclude", "\n<include filename='no.xml'/>", "scene.xml:3: ", "'no.xml' does not exist"},
    {"AliasOfNothing", "<alias id='a' as='b'/>", "scene.xml:2: ", "no object has the id 'a'"},
    {"IncludesItself", "<include filename='scene.xml'/>", "scene.xml:2: ", "includes itself"},
    // camera and film
    {"CropOutsideFilm",
     "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='10'/><integer name='crop_offset_x' "
     "value='5'/>\n<integer name='crop_width' value='6'/></film></sensor>",
     "scene.xml:3: ", "between 1 and 5"},
    {"NoPixels", "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='0'/></film></sensor>",
     "scene.xml:2: ", "between 1 and"},
    {"FovAndFocalLength",
     "<sensor type='perspective'><float name='fov' value='40'/><string name='focal_length' value='50mm'/></sensor>",
     "scene.xml:2: ", "both fov and focal_length"},
    {"FlatFov", "<sensor type='perspective'><float name='fov' value='180'/></sensor>", "scene.xml:2: ", "'fov' is 180"},
    {"UnknownFovAxis",
     "<sensor type='perspective'><float name='fov' value='40'/><string name='fov_axis' value='z'/></sensor>",
     "scene.xml:2: ", "must be one of x, y, diagonal"},
    {"NearBeyondFar", "<sensor type='perspective'><float name='near_clip' value='1e5'/></sensor>",
     "scene.xml:2: ", "smaller than 'far_clip'"},
    {"NoAperture", "<sensor type='thinlens'/>", "scene.xml:2: ", "lacks its aperture_radius"},
    {"ScaledCamera", "<sensor type='perspective'><transform name='to_world'><scale x='2'/></transform></sensor>",
     "scene.xml:2: ", "scales its axes unequally"},
    {"ShearedCamera",
     "<sensor type='perspective'><transform name='to_world'><matrix value='1 0.6 0 0 0.8 0 0 0 "
     "1'/></transform></sensor>",
     "scene.xml:2: ", "sheared"},
    {"TwoFilms", "<sensor type='perspective'><film type='hdrfilm'/><film type='hdrfilm'/></sensor>",
     "scene.xml:2: ", "two <film>"},
    {"TwoIntegrators", "<integrator type='path'/><integrator type='path'/>", "scene.xml:2: ", "two integrators"},
    // materials
    {"UnknownMetal",
     "<shape type='cube'><bsdf type='conductor'><string name='material' value='Unobtainium'/></bsdf></shape>",
     "scene.xml:2: ", "unknown material 'Unobtainium'"},
    {"UnknownMedium", "<shape type='cube'><bsdf type='dielectric'><string name='int_ior' value='soup'/></bsdf></shape>",
     "scene.xml:2: ", "unknown medium 'soup'"},
    {"OneAlpha", "<shape type='cube'><bsdf type='roughconductor'><float name='alpha_u' value='.1'/></bsdf></shape>",
     "scene.xml:2: ", "must be given together"},
    {"TwoSidedGlass", "<shape type='cube'><bsdf type='twosided'><bsdf type='dielectric'/></bsdf></shape>",
     "scene.xml:2: ", "cannot be inside 'twosided'"},
    {"TwoSidedNothing", "<shape type='cube'><bsdf type='twosided'/></shape>", "scene.xml:2: ", "one or two <bsdf>"},
    {"TwoMaterials", "<shape type='cube'><bsdf type='diffuse'/><bsdf type='diffuse'/></shape>",
     "scene.xml:2: ", "two <bsdf>"},
    {"MissingBitmap",
     "<shape type='cube'><bsdf type='diffuse'><texture type='bitmap' name='reflectance'><string name='filename' "
     "value='no.png'/></texture></bsdf></shape>",
     "scene.xml:2: ", "'no.png' does not exist"},
    {"TwoSidedRoughGlass", "<shape type='cube'><bsdf type='twosided'><bsdf type='roughdielectric'/></bsdf></shape>",
     "scene.xml:2: ", "cannot be inside 'twosided'"},
    {"TwoSidedThinGlass", "<shape type='cube'><bsdf type='twosided'><bsdf type='thindielectric'/></bsdf></shape>",
     "scene.xml:2: ", "cannot be inside 'twosided'"},
    {"TwoSidedMask",
     "<shape type='cube'><bsdf type='twosided'><bsdf type='mask'><bsdf type='diffuse'/></bsdf></bsdf></shape>",
     "scene.xml:2: ", "put the 'twosided' inside the mask"},
    {"MaskOfNothing", "<shape type='cube'><bsdf type='mask'/></shape>", "scene.xml:2: ", "needs one <bsdf> inside"},
    {"MaskOfMask",
     "<shape type='cube'><bsdf type='mask'><bsdf type='mask'><bsdf type='diffuse'/></bsdf></bsdf></shape>",
     "scene.xml:2: ", "a mask cannot be inside 'mask'"},
    {"MaskAboveOne",
     "<shape type='cube'><bsdf type='mask'><float name='opacity' value='1.5'/><bsdf type='diffuse'/></bsdf></shape>",
     "scene.xml:2: ", "'opacity' must lie in [0, 1]"},
    {"AnisotropicPlastic",
     "<shape type='cube'><bsdf type='roughplastic'><float name='alpha_u' value='.1'/></bsdf></shape>",
     "scene.xml:2: ", "one roughness for all directions"},
    {"TexturedAlpha",
     "<shape type='cube'><bsdf type='roughplastic'><texture name='alpha' type='checkerboard'/></bsdf></shape>",
     "scene.xml:2: ", "a texture for 'alpha' is not available yet"},
    {"TexturedGlassAlpha",
     "<shape type='cube'><bsdf type='roughdielectric'><texture name='alpha' type='checkerboard'/></bsdf></shape>",
     "scene.xml:2: ", "a texture for 'alpha' is not available yet"},
    {"EqualIndices",
     "<shape type='cube'><bsdf type='roughdielectric'><float name='int_ior' value='1.5'/><float name='ext_ior' "
     "value='1.5'/></bsdf></shape>",
     "scene.xml:2: ", "int_ior and ext_ior must differ"},
    {"IndexBeyondAllMedia",
     "<shape type='cube'><bsdf type='plastic'>\n<float name='int_ior' value='3e3'/></bsdf></shape>",
     "scene.xml:3: ", "differ by more than 1000 times"},
    {"TexturedRoughness",
     "<shape type='cube'><bsdf type='principled'><texture name='roughness' type='checkerboard'/></bsdf></shape>",
     "scene.xml:2: ", "a texture for 'roughness' is not available yet"},
    {"RoughnessAboveOne",
     "<shape type='cube'><bsdf type='principled'><float name='roughness' value='1.1'/></bsdf></shape>",
     "scene.xml:2: ", "roughness"},
    {"EtaAndSpecular",
     "<shape type='cube'><bsdf type='principled'><float name='eta' value='1.5'/><float name='specular' "
     "value='.5'/></bsdf></shape>",
     "scene.xml:2: ", "both eta and specular"},
    // shapes and lights
    {"NoFilename", "<shape type='obj'/>", "scene.xml:2: ", "lacks its filename"},
    {"MissingMesh", "<shape type='ply'><string name='filename' value='no.ply'/></shape>",
     "scene.xml:2: ", "'no.ply' does not exist"},
    {"CylinderWithoutLength", "<shape type='cylinder'><point name='p1' value='0'/></shape>",
     "scene.xml:2: ", "no length"},
    {"InstanceOfNothing", "<shape type='instance'/>", "scene.xml:2: ", "a <ref> to one shapegroup"},
    {"GlowingGroup", "<shape type='shapegroup'><shape type='cube'>\n<emitter type='area'/></shape></shape>",
     "scene.xml:3: ", "cannot emit light"},
    {"NestedGroup", "<shape type='shapegroup'><shape type='shapegroup'/></shape>",
     "scene.xml:2: ", "cannot be inside a shapegroup"},
    {"LightWithoutArea",
     "<shape type='rectangle'><transform name='to_world'><scale x='1e-25' y='1e-25'/></transform>\n<emitter "
     "type='area'/></shape>",
     "scene.xml:3: ", "has no area"},
    {"AreaLightOutsideShape", "<emitter type='area'/>", "scene.xml:2: ", "must be inside the <shape>"},
    {"MapWithoutFile", "<emitter type='envmap'/>", "scene.xml:2: ", "lacks its filename"},
    {"MapMissing", "\n<emitter type='envmap'><string name='filename' value='no.exr'/></emitter>",
     "scene.xml:3: ", "'no.exr' does not exist"},
    {"MapWithNegativeScale",
     "<emitter type='envmap'><string name='filename' value='no.exr'/>\n<float name='scale' value='-1'/></emitter>",
     "scene.xml:3: ", "must be at least 0"},
    {"ShearedMap",
     "<emitter type='envmap'><string name='filename' value='no.exr'/>\n<transform name='to_world'><matrix value='1 0.6 "
     "0 0 0.8 0 0 0 1'/></transform></emitter>",
     "scene.xml:3: ", "sheared"},
    {"TwoSkies", "<emitter type='constant'/>\n<emitter type='constant'/>", "scene.xml:3: ", "two surrounding emitters"},
    {"PointLightTwice",
     "<emitter type='point'><point name='position' value='1'/><transform name='to_world'/></emitter>",
     "scene.xml:2: ", "both position and to_world"},
    {"NoDirection", "<emitter type='directional'><vector name='direction' value='0'/></emitter>",
     "scene.xml:2: ", "has no length"},
    {"TexturedLight",
     "<shape type='cube'><emitter type='area'><texture name='radiance' type='checkerboard'/></emitter></shape>",
     "scene.xml:2: ", "not available yet"},
    // the file itself
    {"SecondRoot", "</scene>\n<scene version='3.0.0'>", "scene.xml:3: ", "follows the file's only element"},
    {"NotWellFormed", "<shape type='cube'>\n<oops", "scene.xml:", "is not well-formed XML"},
};

class BadSceneTest : public SceneFiles, public testing::WithParamInterface<BadScene> {};

TEST_P(BadSceneTest, MessageNamesFileAndLine) {
  const std::string message = error_of(GetParam().body);
  EXPECT_EQ(message.find(path(GetParam().where)), 0u) << message;
  EXPECT_NE(message.find(GetParam().what), std::string::npos) << message;
}

INSTANTIATE_TEST_SUITE_P(SceneErrors, BadSceneTest, testing::ValuesIn(k_bad_scenes),
                         [](const auto& bad) { return std::string(bad.param.name); });

// ---------------------------------------------------------------- files

TEST_F(SceneErrors, FilesThatAreNoScenes) {
  const auto message = [&](const std::string& file) {
    try {
      load_file(file);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message(path("no.xml")).find("no.xml: cannot be read"), std::string::npos);
  EXPECT_NE(message(path("")).find("cannot be read"), std::string::npos);
  EXPECT_NE(message(write("empty.xml", "")).find("empty.xml: cannot be read"), std::string::npos);
  EXPECT_NE(message(write("blank.xml", "<!-- nothing -->")).find("blank.xml:"), std::string::npos);
  EXPECT_NE(message(write("bsdf.xml", "<bsdf version=\"3.0.0\"/>")).find("bsdf.xml:1: starts with <bsdf>"),
            std::string::npos);
  EXPECT_NE(message(write("version.xml", "\n<scene/>")).find("version.xml:2: <scene> lacks its version"),
            std::string::npos);
}

TEST_F(SceneErrors, IncludeCyclesAreFoundAcrossFiles) {
  write("a.xml", "<scene version=\"3.0.0\">\n\n<include filename=\"b.xml\"/></scene>");
  write("b.xml", "<scene version=\"3.0.0\">\n<include filename=\"./a.xml\"/></scene>");
  const std::string message = error_of("<include filename=\"a.xml\"/>");
  EXPECT_NE(message.find("b.xml:2: "), std::string::npos) << message;
  EXPECT_NE(message.find("includes itself"), std::string::npos) << message;
}

TEST_F(SceneErrors, ErrorsInIncludedFilesNameThem) {
  write("part.xml",
        "<scene version=\"3.0.0\">\n\n<shape type=\"sphere\"><float name=\"radius\" value=\"-1\"/></shape></scene>");
  const std::string message = error_of("<include filename=\"part.xml\"/>");
  EXPECT_EQ(message.find(path("part.xml:3: ")), 0u) << message;
}

TEST_F(SceneErrors, ErrorsInMeshFilesNameThem) {
  write("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
  const std::string message = error_of("<shape type='obj'><string name='filename' value='m.obj'/></shape>");
  EXPECT_EQ(message.find(path("m.obj")), 0u) << message;
}

TEST_F(SceneErrors, DeepNestingIsRefused) {
  std::string body;
  for (int i = 0; i < 1000; ++i) body += "<bsdf type='twosided'>";
  for (int i = 0; i < 1000; ++i) body += "</bsdf>";
  EXPECT_NE(error_of(body).find("nested more than"), std::string::npos);
}

TEST_F(SceneErrors, ParametersThatBlowUpAreRefused) {
  std::string body = "<default name='x0' value='aaaaaaaaaaaaaaaa'/>";
  for (int i = 1; i < 40; ++i) {
    const std::string before = "$x" + std::to_string(i - 1);
    body += "<default name='x" + std::to_string(i) + "' value='" + before + before + "'/>";
  }
  EXPECT_NE(error_of(body).find("grows beyond"), std::string::npos);
}

TEST_F(SceneErrors, OtherEncodingsAreRefused) {
  const std::string text = "<scene version=\"3.0.0\"/>";
  std::string wide;
  for (const char c : text) wide += std::string(1, c) + '\0';
  const std::string latin = "<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\n" + text;
  for (const std::string& bytes : {wide, "\xff\xfe" + wide, latin}) {
    try {
      load_file(write("wide.xml", bytes));
      FAIL();
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find("save it as UTF-8"), std::string::npos) << e.what();
    }
  }
}

// ---------------------------------------------------------------- unknown things

struct UnknownThing {
  const char* name;
  const char* body;
  const char* where;
  const char* what;
};
void PrintTo(const UnknownThing& thing, std::ostream* out) { *out << thing.name; }

constexpr UnknownThing k_unknown_things[] = {
    {"Element", "\n<thing/>", "scene.xml:3: ", "unknown element <thing>"},
    {"Attribute", "<shape type='cube' colour='red'/>", "scene.xml:2: ", "unknown attribute 'colour' of <shape>"},
    {"Property", "<shape type='cube'>\n<float name='size' value='1'/></shape>",
     "scene.xml:3: ", "unknown property 'size' of <shape type=\"cube\">"},
    {"ChildOfAReference",
     "<bsdf type='diffuse' id='a'/><shape type='cube'><ref id='a'>\n<float name='alpha' value='.3'/></ref></shape>",
     "scene.xml:3: ", "<float> has no meaning inside <ref>"},
    {"ChildOfANumber",
     "<shape type='sphere'><float name='radius' value='1'>\n<float name='b' value='2'/></float></shape>",
     "scene.xml:3: ", "<float> has no meaning inside <float>"},
    {"PropertyOfDaylight",
     "<emitter type='constant'><spectrum type='d65' name='radiance'>\n<float name='value' "
     "value='2'/></spectrum></emitter>",
     "scene.xml:3: ", "unknown property 'value' of <spectrum type=\"d65\">"},
    {"NestedObject", "<shape type='cube'><medium type='homogeneous'/></shape>", "scene.xml:2: ", "<medium>"},
    {"Shape", "<shape type='sdfgrid'/>", "scene.xml:2: ", "unknown shape type 'sdfgrid'"},
    {"Bsdf", "<shape type='cube'><bsdf type='hair'/></shape>", "scene.xml:2: ", "unknown bsdf type 'hair'"},
    {"PrincipledLobe", "<shape type='cube'><bsdf type='principled'>\n<float name='sheen' value='.5'/></bsdf></shape>",
     "scene.xml:3: ", "'sheen' of <bsdf type=\"principled\"> is left out"},
    {"Emitter", "<emitter type='spot'/>", "scene.xml:2: ", "unknown emitter type 'spot'"},
    {"Texture", "<shape type='cube'><bsdf type='diffuse'><texture type='wood' name='reflectance'/></bsdf></shape>",
     "scene.xml:2: ", "unknown texture type 'wood'"},
    {"Sensor", "<sensor type='fisheye'/>", "scene.xml:2: ", "unknown sensor type 'fisheye'"},
    {"Film", "<sensor type='perspective'><film type='specfilm'/></sensor>", "scene.xml:2: ", "unknown film type"},
    {"Filter", "<sensor type='perspective'><film type='hdrfilm'><rfilter type='mitchell'/></film></sensor>",
     "scene.xml:2: ", "unknown filter type 'mitchell'"},
    {"Integrator", "<integrator type='ptracer'/>", "scene.xml:2: ", "unknown integrator type 'ptracer'"},
    {"PlaceInScene", "<film type='hdrfilm'/>", "scene.xml:2: ", "<film> has no meaning directly inside <scene>"},
    {"PlaceInTransform",
     "<shape type='cube'><transform name='to_world'><float name='a' value='1'/></transform></shape>",
     "scene.xml:2: ", "<float> has no meaning inside <transform>"},
};

class UnknownThingTest : public SceneFiles, public testing::WithParamInterface<UnknownThing> {};

TEST_P(UnknownThingTest, WarnsAndFailsInStrictMode) {
  EXPECT_EQ(error_of(GetParam().body), "");
  EXPECT_TRUE(warned(path(GetParam().where) + GetParam().what) ||
              (warned(path(GetParam().where)) && warned(GetParam().what)));
  strict = true;
  const std::string message = error_of(GetParam().body);
  EXPECT_EQ(message.find(path(GetParam().where)), 0u) << message;
  EXPECT_NE(message.find(GetParam().what), std::string::npos) << message;
}

INSTANTIATE_TEST_SUITE_P(SceneErrors, UnknownThingTest, testing::ValuesIn(k_unknown_things),
                         [](const auto& thing) { return std::string(thing.param.name); });

TEST_F(SceneErrors, UnusedParameterFailsInStrictMode) {
  strict = true;
  parameters = {{"spp", "4"}};
  EXPECT_NE(error_of(k_sensor).find("'spp' is not used"), std::string::npos);
}

// ---------------------------------------------------------------- mutations

// However a scene's bytes are altered, the loader returns a scene or throws Error.
TEST_F(SceneErrors, MutatedScenesThrowNothingButErrors) {
  write("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const std::string original = R"(<scene version="3.0.0"><default name="r" value="2"/>
<integrator type="path"><integer name="max_depth" value="4"/></integrator>
<sensor type="thinlens"><float name="aperture_radius" value=".1"/><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0 -5 2" target="0 0 0" up="0 0 1"/></transform>
<film type="hdrfilm"><integer name="width" value="32"/><rfilter type="gaussian"/></film><sampler type="independent"/></sensor>
<bsdf type="twosided" id="m"><bsdf type="roughconductor"><string name="material" value="Au"/></bsdf></bsdf>
<shape type="shapegroup" id="g"><shape type="cube"><ref id="m"/></shape></shape>
<shape type="instance"><transform name="to_world"><scale value="1 2 3"/><rotate y="1" angle="9"/></transform><ref id="g"/></shape>
<shape type="sphere"><float name="radius" value="$r"/><emitter type="area"><rgb name="radiance" value="1 2 3"/></emitter></shape>
<shape type="cylinder"><point name="p1" x="1" y="0" z="2"/><bsdf type="dielectric"><string name="int_ior" value="bk7"/></bsdf></shape>
<shape type="obj"><string name="filename" value="m.obj"/><bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf></shape>
<emitter type="constant"><spectrum name="radiance" value="400:1, 700:2"/></emitter></scene>)";
  const std::string alphabet = std::string("<>/\"'=$\\ \n\t0123456789-+.e,:abcxyz_#&;\xff") + '\0';
  std::mt19937 random(20240229);
  const auto below = [&](size_t n) { return size_t(random() % n); };
  int loaded = 0, refused = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = original;
    for (size_t edits = 1 + below(4); edits > 0 && !text.empty(); --edits) {
      const size_t at = below(text.size()), length = std::min(1 + below(12), text.size() - at);
      switch (below(5)) {
        case 0:
          text[at] = alphabet[below(alphabet.size())];
          break;
        case 1:
          text.erase(at, length);
          break;
        case 2:
          text.insert(below(text.size()), text.substr(at, length));
          break;
        case 3:
          text.resize(below(20) == 0 ? at : text.size());
          break;
        default:
          text.insert(at, 1, alphabet[below(alphabet.size())]);
          break;
      }
    }
    try {
      const Scene scene = load_file(write("fuzz.xml", text));
      for (const Instance& instance : scene.instances) {
        ASSERT_LT(instance.shape, scene.shapes.size());
        ASSERT_LT(instance.bsdf, scene.bsdfs.size());
        for (int c = 0; c < 4; ++c)
          for (int r = 0; r < 3; ++r) ASSERT_TRUE(std::isfinite(instance.to_object[c][r])) << text;
      }
      ++loaded;
    } catch (const Error&) {
      ++refused;
    }
  }
  // Both outcomes must occur often, or the mutations test nothing.
  EXPECT_GT(loaded, 100);
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace fieldtrace
