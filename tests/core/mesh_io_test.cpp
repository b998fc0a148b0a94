// OBJ and PLY: content, round trips, every kind of bad input with its message, and a seeded fuzz test.
#include "core/mesh/mesh_io.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <bit>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <new>
#include <random>
#include <sstream>

#include "core/mesh/mesh_procedural.h"
#include "tests/support/mesh_checks.h"

namespace {
// What this program has allocated.
std::atomic<uint64_t> allocation_count = 0, allocation_bytes = 0;
}  // namespace

// Not inlined: GCC would warn about the calls of malloc() and free() that it then sees.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++allocation_count;
  allocation_bytes += size;
  if (void* p = std::malloc(size)) return p;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;
using namespace mesh_checks;

class MeshIo : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("fieldtrace_mesh_io_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path(name), std::ios::binary) << bytes;
    return path(name);
  }
  TriangleMesh load(const std::string& name, const std::string& bytes, const MeshLoadOptions& options = {}) {
    warnings_.clear();
    return load_mesh(write(name, bytes), options, [this](const std::string& w) { warnings_.push_back(w); });
  }
  // The error message without the folder's name; "no error" if there is none.
  std::string failure(const std::string& name, const std::string& bytes) {
    try {
      load(name, bytes);
    } catch (const Error& e) {
      return strip(e.what());
    }
    return "no error";
  }
  std::string strip(std::string message) const {
    const std::string prefix = folder_.string() + "/";
    if (message.rfind(prefix, 0) == 0) message.erase(0, prefix.size());
    return message;
  }
  std::string only_warning() const { return warnings_.size() == 1 ? strip(warnings_[0]) : "not one warning"; }

  fs::path folder_;
  std::vector<std::string> warnings_;
};

void expect_same(const TriangleMesh& a, const TriangleMesh& b) {
  EXPECT_EQ(a.positions, b.positions);
  EXPECT_EQ(a.texcoords, b.texcoords);
  EXPECT_EQ(a.triangles, b.triangles);
  ASSERT_EQ(a.normals.size(), b.normals.size());
  // validate_mesh normalises again.
  for (size_t i = 0; i < a.normals.size(); ++i) ASSERT_LT(glm::length(a.normals[i] - b.normals[i]), gamma_bound(6));
}

const std::string k_square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

// ---------------------------------------------------------------- OBJ

TEST_F(MeshIo, ObjReadsPolygonsGroupsAndNegativeIndices) {
  const TriangleMesh mesh = load("a.obj", "# square\nmtllib none.mtl\no one\n" + k_square +
                                              "g left\nusemtl red\ns 1\nf 1 2 3 4\ng right\nf -4 -3 -2\nl 1 2\n");
  EXPECT_EQ(mesh.positions.size(), 4u);
  EXPECT_EQ(mesh.triangles, (std::vector<UVec3>{{0, 1, 2}, {0, 2, 3}, {0, 1, 2}}));
  EXPECT_TRUE(mesh.normals.empty());
  EXPECT_TRUE(mesh.texcoords.empty());
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(MeshIo, ObjMakesOneVertexOfEachDistinctTriple) {
  const std::string text = k_square +
                           "vt 0 0\nvt 1 0\nvt 1 0.25\nvn 0 0 2\nvn 0 0 -1\n"
                           "f 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/3/1 4/1/1\nf 3/3/2 2/2/2 1/1/2\n";
  const TriangleMesh mesh = load("a.obj", text, {.flip_tex_coords = false});
  EXPECT_EQ(mesh.positions.size(), 7u);
  EXPECT_EQ(mesh.triangles, (std::vector<UVec3>{{0, 1, 2}, {0, 2, 3}, {4, 5, 6}}));
  EXPECT_EQ(mesh.normals[0], Vec3(0, 0, 1));
  EXPECT_EQ(mesh.normals[4], Vec3(0, 0, -1));
  EXPECT_EQ(mesh.texcoords[2], Vec2(1.0f, 0.25f));
}

// A position with a normal for each of very many faces is not searched among all of them.
TEST_F(MeshIo, ObjReadsVerticesOfManyNormals) {
  constexpr int k_faces = 100'000;
  std::string text = "v 0 1 0\n";
  for (int i = 0; i < k_faces; ++i) text += fmt::format("v {} 0 {}\nvn {} 1 1\n", i, i % 2, i + 1);
  for (int i = 0; i + 1 < k_faces; ++i)
    text += fmt::format("f 1//{} {}//{} {}//{}\n", i + 1, i + 2, i + 1, i + 3, i + 1);
  const TriangleMesh mesh = load("a.obj", text);
  EXPECT_EQ(mesh.triangles.size(), size_t(k_faces - 1));
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (int c = 0; c < 3; ++c) ASSERT_GT(glm::dot(mesh.normals[mesh.triangles[i][c]], Vec3(float(i) + 1, 1, 1)), 0.0f);
    ASSERT_EQ(mesh.positions[mesh.triangles[i].x], Vec3(0, 1, 0));
  }
}

TEST_F(MeshIo, ObjAcceptsOddButLegalText) {
  const TriangleMesh commented = load("a.obj",
                                      "# made by C:\\tmp\\\nv 0 0 0 # C:\\\nv 1 0 0\t#\n  # C:\\\nv 0 1 0\ng #1\n"
                                      "f 1 2 3 # all\n");
  EXPECT_EQ(commented.positions, (std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(commented.triangles, (std::vector<UVec3>{{0, 1, 2}}));
  const TriangleMesh crlf = load("a.obj", "v 0 0 0\r\nv +1. .0 -0e3\r\n\tv 1 1E0 0 1.0\r\nf 1/ 2// \\\r\n  3\r\n");
  EXPECT_EQ(crlf.triangles, (std::vector<UVec3>{{0, 1, 2}}));
  EXPECT_EQ(crlf.positions[1], Vec3(1, 0, 0));
  const TriangleMesh marked = load("c.obj", "\xEF\xBB\xBFv 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n");
  EXPECT_EQ(marked.positions, (std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}));
  EXPECT_EQ(load("d.obj", "v 0 0 0\r\rv 1 0 0\n\r\nv 1 1 0\r\n\nf 1 2 3\r").triangles.size(), 1u);
  const TriangleMesh mac = load("b.obj", "v 0 0 0\rv 1 0 0\rv 1 1 0\rf 1 2 3");
  EXPECT_EQ(mac.triangles.size(), 1u);
  const TriangleMesh colours = load("c.obj", "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nf 1 2 3\n");
  EXPECT_EQ(colours.positions[2], Vec3(1, 1, 0));
}

TEST_F(MeshIo, ObjComputesOnlyTheNormalsThatAreMissing) {
  const TriangleMesh mesh = load("a.obj", k_square + "vn 0 1 0\nf 1//1 2 3\n");
  EXPECT_EQ(mesh.normals, (std::vector<Vec3>{{0, 1, 0}, {0, 0, 1}, {0, 0, 1}}));
  EXPECT_EQ(only_warning(), "a.obj: 2 normals zero or not finite, computed anew");
}

TEST_F(MeshIo, ObjErrorsNameTheLine) {
  const auto obj = [&](const std::string& more) { return failure("a.obj", k_square + more); };
  EXPECT_EQ(obj("f 1 2 5\n"), "a.obj:5: the face refers to vertex 5, but there are 4 up to here");
  EXPECT_EQ(obj("# c\n\nf 1 2 -5\n"), "a.obj:7: the face refers to vertex -5, but there are 4 up to here");
  EXPECT_EQ(obj("f 1/1 2/1 3/1\n"), "a.obj:5: the face refers to texture coordinate 1, but there are 0 up to here");
  EXPECT_EQ(obj("f 1//2 2//2 3//2\n"), "a.obj:5: the face refers to normal 2, but there are 0 up to here");
  EXPECT_EQ(obj("f 0 1 2\n"), "a.obj:5: \"0\" is no corner of a face, write v, v/t, v//n or v/t/n counted from 1");
  EXPECT_EQ(obj("f 1 x 2\n").substr(0, 13), "a.obj:5: \"x\" ");
  EXPECT_EQ(obj("f 1 2 4294967297\n").substr(0, 9), "a.obj:5: ");  // must not wrap to 1
  EXPECT_EQ(obj("v 1 2\n"), "a.obj:5: \"v\" needs 3 numbers, found 2");
  EXPECT_EQ(obj("v 1 2"), "a.obj:5: \"v\" needs 3 numbers, found 2; the file is cut short");
  EXPECT_EQ(obj("v 1 2,5 3\n"), "a.obj:5: \"2,5\" is not a number");
  EXPECT_EQ(obj("v 1 nan 3\nf 1 2 3\n"), "a.obj:5: vertex 5 is not finite, mend the mesh");
  EXPECT_EQ(obj("v 1 -inf 3\nf 1 2 3\n"), "a.obj:5: vertex 5 is not finite, mend the mesh");
  EXPECT_EQ(obj("v 1 1e39 3\nf 1 2 3\n"), "a.obj:5: vertex 5 is not finite, mend the mesh");
  EXPECT_EQ(obj("v 1 1e9999999999 3\n"), "a.obj:5: \"1e9999999999\" is not a number");
  EXPECT_EQ(obj("f 1 2 \\\n3 9\n"), "a.obj:5: the face refers to vertex 9, but there are 4 up to here");
  EXPECT_EQ(obj("f 1 2 \\\n3\nf 1 2 9\n"), "a.obj:7: the face refers to vertex 9, but there are 4 up to here");
  EXPECT_EQ(obj("f 1 2"), "a.obj:5: the file ends within this face, it is cut short");
  EXPECT_EQ(obj(""), "a.obj: has no triangles, nothing to render");
  EXPECT_EQ(failure("a.obj", ""), "a.obj: has no triangles, nothing to render");
}

// ---------------------------------------------------------------- PLY

template <class T>
void put(std::string& out, T value, bool big) {
  auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
  if (big) std::reverse(raw.begin(), raw.end());
  out.append(raw.data(), raw.size());
}

// A PLY file with everything that a reader must skip: unknown elements before, between and after the known ones, and
// unknown properties, lists among them. One quad and one triangle over four vertices.
std::string exotic_ply(const std::string& format) {
  std::string s =
      "ply\r\nformat " + format +
      " 1.0\r\ncomment by hand\r\nobj_info none\r\nelement camera 2\r\nproperty list ushort double path\r\n"
      "property char c\r\nelement vertex 4\r\nproperty uchar red\r\nproperty double x\r\nproperty float y\r\n"
      "property list uchar short tags\r\nproperty short z\r\nproperty float32 u\r\nproperty float64 v\r\n"
      "element strange 1\r\nproperty uint16 q\r\nelement face 2\r\nproperty int8 a\r\n"
      "property list int32 uint16 vertex_index\r\nproperty list uchar float uv\r\nelement tail 1\r\nproperty int t\r\n"
      "end_header\r\n";
  const double xy[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  if (format == "ascii") {
    s += "2 0.5 1.5 7\r\n0 -3\r\n";
    for (int i = 0; i < 4; ++i) {
      std::ostringstream line;
      line << "255 " << xy[i][0] << " " << xy[i][1] << (i % 2 ? " 2 5 6 " : " 0 ") << i << " 0.5 0.25\r\n";
      s += line.str();
    }
    return s + "9\r\n1 4 0 1 2 3 2 .5 .5\r\n1 3 3 2 1 0\r\n77\r\n";
  }
  const bool big = format == "binary_big_endian";
  put(s, uint16_t(2), big), put(s, 0.5, big), put(s, 1.5, big), put(s, int8_t(7), big);
  put(s, uint16_t(0), big), put(s, int8_t(-3), big);
  for (int i = 0; i < 4; ++i) {
    put(s, uint8_t(255), big), put(s, xy[i][0], big), put(s, float(xy[i][1]), big);
    put(s, uint8_t(i % 2 ? 2 : 0), big);
    if (i % 2) put(s, int16_t(5), big), put(s, int16_t(6), big);
    put(s, int16_t(i), big), put(s, 0.5f, big), put(s, 0.25, big);
  }
  put(s, uint16_t(9), big);
  put(s, int8_t(1), big), put(s, int32_t(4), big);
  for (int i = 0; i < 4; ++i) put(s, uint16_t(i), big);
  put(s, uint8_t(2), big), put(s, 0.5f, big), put(s, 0.5f, big);
  put(s, int8_t(1), big), put(s, int32_t(3), big);
  for (int i = 3; i > 0; --i) put(s, uint16_t(i), big);
  put(s, uint8_t(0), big), put(s, int32_t(77), big);
  return s;
}

TEST_F(MeshIo, PlySkipsWhatItDoesNotKnowInEveryFormat) {
  for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    SCOPED_TRACE(format);
    const TriangleMesh mesh = load("a.ply", exotic_ply(format));
    EXPECT_EQ(mesh.positions, (std::vector<Vec3>{{0, 0, 0}, {1, 0, 1}, {1, 1, 2}, {0, 1, 3}}));
    EXPECT_EQ(mesh.triangles, (std::vector<UVec3>{{0, 1, 2}, {0, 2, 3}, {3, 2, 1}}));
    EXPECT_EQ(mesh.texcoords, std::vector<Vec2>(4, Vec2(0.5f, 0.25f)));
    EXPECT_TRUE(mesh.normals.empty());
    EXPECT_TRUE(warnings_.empty());
  }
}

TEST_F(MeshIo, PlyRoundTripKeepsEveryBit) {
  TriangleMesh bare = make_supershape({.around = 24, .along = 12});
  bare.normals.clear();
  TriangleMesh no_uv = make_cube();
  no_uv.texcoords.clear();
  for (const TriangleMesh& mesh : {make_knot({.along = 64, .around = 8}), bare, no_uv}) {
    save_ply(path("a.ply"), mesh);
    expect_same(load_mesh(path("a.ply")), mesh);
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);  // no temporary file remains
}

TEST_F(MeshIo, SaveFailsWithAMessage) {
  try {
    save_ply(path("none/a.ply"), make_plane());
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(strip(e.what()), "none/a.ply: cannot be written: No such file or directory (make the folder first)");
  }
  fs::create_directory(path("taken.ply"));
  EXPECT_THROW(save_ply(path("taken.ply"), make_plane()), Error);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);
}

const std::string k_ply_head =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
const std::string k_ply_vertices = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

TEST_F(MeshIo, AsciiPlyErrorsNameTheLine) {
  const auto ply = [&](const std::string& body) { return failure("a.ply", k_ply_head + body); };
  EXPECT_EQ(ply(k_ply_vertices + "3 0 1 2\n3 0 2 3\n"), "no error");
  EXPECT_EQ(ply(k_ply_vertices + "3 0 1 2\n3 0 2 4\n"),
            "a.ply:15: face 1 refers to vertex 4, but there are 4 vertices, counted from 0");
  EXPECT_EQ(ply(k_ply_vertices + "3 0 1 -1\n3 0 2 3\n"),
            "a.ply:14: face 0 refers to vertex -1, but there are 4 vertices, counted from 0");
  EXPECT_EQ(ply("0 0 0\n1 nan 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"),
            "a.ply:11: vertex 1 is not finite (1 nan 0), mend the mesh");
  EXPECT_EQ(ply("0 0 0\n1 1e40 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"),
            "a.ply:11: vertex 1 is not finite (1 inf 0), mend the mesh");
  EXPECT_EQ(ply("0 0 0\n1 1e-999 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"), "no error");
  EXPECT_EQ(ply("0 0 0\n1 x 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"), "a.ply:11: \"x\" is not a number");
  EXPECT_EQ(ply("0 0 0\n1 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"),
            "a.ply:11: fewer values than the header announces, add the missing ones");
  EXPECT_EQ(ply("0 0 0\n1 0 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"),
            "a.ply:11: more values than the header announces, from \"0\" on");
  EXPECT_EQ(ply(k_ply_vertices + "3 0 1 2\n"),
            "a.ply:14: the file ends after 1 of 2 records of element \"face\", it is cut short");
  EXPECT_EQ(ply(k_ply_vertices + "3 0 1 2\n3 0 2"), "a.ply:15: the file ends within this line, it is cut short");
  EXPECT_EQ(ply(k_ply_vertices + "-3 0 1 2\n3 0 2 3\n"), "a.ply:14: -3 is no length of list \"vertex_indices\"");
  EXPECT_EQ(ply("0 0\n").substr(0, 43), "a.ply:3: 4 records of element \"vertex\" need");
  EXPECT_EQ(load("a.ply", k_ply_head + k_ply_vertices + "3 0 1 2\n3 0 2 3\n\nmore\n").triangles.size(), 2u);
  EXPECT_EQ(only_warning(), "a.ply:16: what follows the last element is ignored");
}

TEST_F(MeshIo, BinaryPlyErrorsSayWhatIsCut) {
  save_ply(path("good.ply"), make_cube());
  std::ifstream in(path("good.ply"), std::ios::binary);
  const std::string good((std::istreambuf_iterator<char>(in)), {});
  EXPECT_EQ(failure("a.ply", good.substr(0, good.size() - 5)),
            "a.ply: the file ends within record 11 of 12 of element \"face\", it is cut short");
  EXPECT_EQ(failure("a.ply", good.substr(0, good.size() - 200)).substr(0, 38),
            "a.ply:3: 24 records of element \"vertex");
  std::string nan = good;
  const size_t body = good.find("end_header\n") + 11;
  for (size_t i = 0; i < 4; ++i) nan[body + 32 + i] = char(0xff);  // x of vertex 1
  EXPECT_EQ(failure("a.ply", nan).substr(0, 36), "a.ply: vertex 1 is not finite (-nan ");
  std::string index = good;
  index[index.size() - 1] = 0x01;
  EXPECT_EQ(failure("a.ply", index).substr(0, 31), "a.ply: face 11 refers to vertex");
  EXPECT_EQ(load("a.ply", good + "x").triangles.size(), 12u);
  EXPECT_EQ(only_warning(), "a.ply: 1 bytes after the last element are ignored");
  // A huge count must fail at once, without allocating its memory.
  std::string huge = good;
  huge.replace(huge.find("vertex 24"), 9, "vertex 4000000000");
  EXPECT_EQ(failure("a.ply", huge).substr(0, 50), "a.ply:3: 4000000000 records of element \"vertex\" ne");
  huge.replace(huge.find("vertex 4000000000"), 17, "vertex 18446744073709551615");
  EXPECT_EQ(failure("a.ply", huge), "a.ply:3: too many vertices for 32-bit indices");
}

TEST_F(MeshIo, PlyHeaderErrorsNameTheLine) {
  const auto ply = [&](const std::string& text) { return failure("a.ply", text); };
  const std::string start = "ply\nformat ascii 1.0\n";
  EXPECT_EQ(ply("solid x\n"), "a.ply:1: does not begin with \"ply\", this is no PLY file");
  EXPECT_EQ(ply(""), "a.ply: the PLY header has no end_header line, the file is cut short or no PLY file");
  EXPECT_EQ(ply("ply\n"), "a.ply:1: the PLY header has no end_header line, the file is cut short or no PLY file");
  EXPECT_EQ(ply("ply\nformat text 1.0\n"),
            "a.ply:2: unknown PLY format \"text\", use ascii, binary_little_endian or binary_big_endian");
  EXPECT_EQ(ply("ply\nformat ascii 2.0\n"), "a.ply:2: unknown PLY version \"2.0\", only 1.0 exists");
  EXPECT_EQ(ply("ply\nend_header\n"), "a.ply:2: the PLY header has no format line");
  EXPECT_EQ(ply(start + "elephant\n"), "a.ply:3: unknown word \"elephant\" in the PLY header");
  EXPECT_EQ(ply(start + "element vertex -1\n"), "a.ply:3: an element line reads \"element NAME COUNT\"");
  EXPECT_EQ(ply(start + "property float x\n"), "a.ply:3: a property before the first element");
  EXPECT_EQ(ply(start + "element vertex 1\nproperty half x\n"), "a.ply:4: unknown PLY type \"half\"");
  EXPECT_EQ(ply(start + "element vertex 1\nproperty list float int x\n"),
            "a.ply:4: the length of a list must have a whole type");
  EXPECT_EQ(ply(start + "element vertex 1\nproperty int x\nproperty int x\n"),
            "a.ply:5: second property \"x\" of the element");
  EXPECT_EQ(ply(start + "end_header\n"), "a.ply: the PLY header has no element \"vertex\", nothing to render");
  EXPECT_EQ(ply(start + "element vertex 1\nproperty float x\nend_header\n0\n"),
            "a.ply: the PLY header has no element \"face\", export the mesh with its faces");
  EXPECT_EQ(ply(start + "element vertex 1\nproperty float x\nproperty float z\nelement face 0\nend_header\n0 0\n"),
            "a.ply:3: element \"vertex\" has no property \"y\", add it");
  EXPECT_EQ(
      ply(start + "element vertex 4\nelement face 1\nproperty list int int vertex_indices\nend_header\n4 0 1 2 3\n"),
      "a.ply:3: element \"vertex\" has no property \"x\", add it");
  EXPECT_EQ(ply(start + "element vertex 0\nelement face 1\nproperty int a\nend_header\n0\n"),
            "a.ply:4: element \"face\" has no list vertex_indices, add it");
  EXPECT_EQ(ply(start + "element vertex 0\nelement face 0\nend_header\n"),
            "a.ply: has no triangles, nothing to render");
}

// ---------------------------------------------------------------- both

TEST_F(MeshIo, FilesThatCannotBeReadAreNamed) {
  const auto message = [&](const std::string& name) {
    try {
      load_mesh(path(name));
    } catch (const Error& e) {
      return strip(e.what());
    }
    return std::string("no error");
  };
  EXPECT_EQ(message("missing.obj"), "missing.obj: no such mesh file, check the path");
  EXPECT_EQ(message("a.stl"), "a.stl: unknown kind of mesh file, convert it to .obj or .ply");
  fs::create_directory(path("folder.ply"));
  EXPECT_EQ(message("folder.ply"), "folder.ply: is a folder, name a .obj or .ply file in it");
}

TEST_F(MeshIo, OptionsDoWhatMitsubaDoes) {
  const std::string obj = k_square + "vt 0.25 0.25\nvn 1 0 0\nf 1/1/1 2/1/1 3/1/1\n";
  EXPECT_EQ(load("a.OBJ", obj).texcoords[0], Vec2(0.25f, 0.75f));  // flipped by default, the convention of OBJ files
  EXPECT_EQ(load("a.obj", obj, {.flip_tex_coords = false}).texcoords[0], Vec2(0.25f, 0.25f));
  EXPECT_TRUE(load("a.obj", obj, {.face_normals = true, .compute_normals = true}).normals.empty());
  EXPECT_EQ(load("a.obj", obj, {.compute_normals = true}).normals[0], Vec3(1, 0, 0));  // normals from the file are kept
  EXPECT_EQ(load("b.obj", k_square + "f 1 2 3\n", {.compute_normals = true}).normals[0], Vec3(0, 0, 1));
  save_ply(path("a.ply"), make_plane());
  EXPECT_EQ(load_mesh(path("a.ply")).texcoords[0], Vec2(0.0f, 0.0f));
  EXPECT_EQ(load_mesh(path("a.ply"), {.flip_tex_coords = true}).texcoords[0], Vec2(0.0f, 1.0f));
}

TEST_F(MeshIo, TheFormatMayBeGiven) {
  const std::string obj = k_square + "f 1 2 3\n";
  EXPECT_EQ(load("scan.bin", obj, {.format = MeshFormat::obj}).triangles.size(), 1u);
  EXPECT_THROW(load("scan.obj", obj, {.format = MeshFormat::ply}), Error);
}

// A square of 2 with a notch from its middle down to (1, .5), from every corner and side.
TEST_F(MeshIo, ConcavePolygonsKeepTheirNotches) {
  const std::vector<Vec3> outline = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {1, 0.5f, 0}, {0, 2, 0}};
  std::mt19937 random(5);
  const auto unit = [&] {
    std::normal_distribution<double> normal;
    return glm::normalize(DVec3(normal(random), normal(random), normal(random)));
  };
  for (size_t first = 0; first < outline.size(); ++first) {
    for (const bool reversed : {false, true}) {
      const DVec3 z = unit(), x = glm::normalize(glm::cross(unit(), z));
      const DMat3 turned(x, glm::cross(z, x), z);
      std::string obj, ply_points, ply_face = "5", face = "f";
      for (size_t i = 0; i < outline.size(); ++i) {
        const size_t at = (first + (reversed ? outline.size() - i : i)) % outline.size();
        const Vec3 p(turned * DVec3(outline[at]));
        obj += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
        ply_points += fmt::format("{} {} {}\n", p.x, p.y, p.z);
        face += fmt::format(" {}", i + 1);
        ply_face += fmt::format(" {}", i);
      }
      const std::string ply =
          "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
          "element face 1\nproperty list uchar int vertex_indices\nend_header\n" +
          ply_points + ply_face + "\n";
      const std::string faces_first =
          "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 5\n"
          "property float x\nproperty float y\nproperty float z\nend_header\n" +
          ply_face + "\n" + ply_points;
      for (const TriangleMesh& mesh :
           {load("a.obj", obj + face + "\n"), load("a.ply", ply), load("a.ply", faces_first)}) {
        ASSERT_EQ(mesh.triangles.size(), 3u);
        double area = 0.0;
        DVec3 sum(0.0);
        for (const UVec3& t : mesh.triangles) {
          const DVec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
          const DVec3 cross = 0.5 * glm::cross(b - a, c - a);
          area += glm::length(cross), sum += cross;
        }
        // The triangles do not overlap: their areas add up to the polygon's.
        EXPECT_NEAR(area, 2.5, 1e-5);
        EXPECT_NEAR(glm::length(sum), 2.5, 1e-5);
      }
      EXPECT_TRUE(warnings_.empty());
    }
  }
}

TEST_F(MeshIo, PolygonsThatCrossThemselvesAreCutAsIfConvexWithAWarning) {
  const TriangleMesh mesh = load("a.obj", "v 0 0 0\nv 2 2 0\nv 2 0 0\nv 0 2 0\nv -1 1 0\nf 1 2 3 4 5\n");
  EXPECT_EQ(mesh.triangles, (std::vector<UVec3>{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}}));
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("cross themselves"), std::string::npos);
}

TEST_F(MeshIo, VerticesThatNoTriangleUsesAreDropped) {
  const std::string header =
      "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
      "property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const TriangleMesh mesh =
      load("a.ply", header + "100 0 0 0 0\n0 0 0 .1 .1\n1 0 0 .2 .2\n0 -1e20 0 0 0\n0 1 0 .3 .3\n3 1 2 4\n");
  EXPECT_EQ(mesh.positions, (std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(mesh.texcoords, (std::vector<Vec2>{Vec2(0.1f), Vec2(0.2f), Vec2(0.3f)}));
  EXPECT_EQ(mesh.triangles, std::vector<UVec3>{UVec3(0, 1, 2)});
}

// Properties that are half of a pair, such as a time t, are no texture coordinates.
TEST_F(MeshIo, PlyTextureCoordinatesAreAWholePair) {
  const auto first = [&](const std::string& names) {
    std::string header = "ply\nformat ascii 1.0\nelement vertex 3\n", values[3];
    std::istringstream words("x y z " + names);
    int k = 0;
    for (std::string name; words >> name; ++k) {
      header += "property float " + name + "\n";
      for (int v = 0; v < 3; ++v)
        values[v] += fmt::format("{} ", name == "x" ? int(v == 1) : name == "y" ? int(v == 2) : k);
    }
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    const TriangleMesh mesh = load("a.ply", header + values[0] + "\n" + values[1] + "\n" + values[2] + "\n3 0 1 2\n");
    return mesh.texcoords.empty() ? Vec2(-1.0f) : mesh.texcoords[0];
  };
  EXPECT_EQ(first("t u v"), Vec2(4, 5));
  EXPECT_EQ(first("s u v"), Vec2(4, 5));
  EXPECT_EQ(first("s t u v"), Vec2(5, 6));
  EXPECT_EQ(first("s t texture_v texture_u"), Vec2(6, 5));
  EXPECT_EQ(first("t s"), Vec2(4, 3));
  EXPECT_EQ(first("u t"), Vec2(-1.0f));
}

TEST_F(MeshIo, TextureCoordinatesOfFacesAreIgnoredWithAWarning) {
  const TriangleMesh mesh =
      load("a.ply",
           "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
           "element face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
           "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1\n");
  EXPECT_TRUE(mesh.texcoords.empty());
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("of faces are ignored"), std::string::npos);
}

TEST_F(MeshIo, DegenerateTrianglesAreDroppedAndCounted) {
  const std::string bad = "f 1 1 2\nf 1 2 2\nf 1 3 5\nf 1 2\n";  // 1, 3 and 5 are collinear
  const TriangleMesh mesh = load("a.obj", k_square + "v 2 2 0\n" + bad + "f 1 2 3\n");
  EXPECT_EQ(mesh.triangles.size(), 1u);
  ASSERT_EQ(warnings_.size(), 2u);
  EXPECT_EQ(strip(warnings_[0]), "a.obj: 1 polygon of fewer than three corners dropped");
  EXPECT_EQ(strip(warnings_[1]), "a.obj: 3 triangles of zero area dropped");
  EXPECT_EQ(failure("a.obj", k_square + "v 2 2 0\n" + bad), "a.obj: every triangle has zero area, mend the mesh");
  // Tiny is not degenerate.
  EXPECT_EQ(load("b.obj", "v 0 0 0\nv 1e-30 0 0\nv 0 1e-30 0\nf 1 2 3\n").triangles.size(), 1u);
}

TEST_F(MeshIo, BadNormalsAndTexcoordsAreMended) {
  const TriangleMesh mesh = load("a.obj", k_square +
                                              "vn 0 0 0\nvn nan 0 1\nvn 0 0 1e-30\nvt nan 0\nvt 1 1\n"
                                              "f 1/1/1 2/2/2 3/2/3\n");
  EXPECT_EQ(mesh.normals, std::vector<Vec3>(3, Vec3(0, 0, 1)));
  EXPECT_EQ(mesh.texcoords[0], Vec2(0.0f, 1.0f));  // 0, then flipped
  ASSERT_EQ(warnings_.size(), 2u);
  EXPECT_EQ(strip(warnings_[0]), "a.obj: 2 normals zero or not finite, computed anew");
  EXPECT_EQ(strip(warnings_[1]), "a.obj: 1 texture coordinate not finite, set to 0");
}

TEST_F(MeshIo, ValidateChecksMeshesFromAnywhere) {
  const auto message = [](TriangleMesh mesh) {
    try {
      validate_mesh(mesh, "knot");
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string("no error");
  };
  TriangleMesh mesh = make_plane();
  EXPECT_EQ(message(mesh), "no error");
  mesh.normals.pop_back();
  EXPECT_EQ(message(mesh), "knot: 3 normals for 4 vertices, give one for each or none");
  mesh = make_plane();
  mesh.texcoords.pop_back();
  EXPECT_EQ(message(mesh), "knot: 3 texture coordinates for 4 vertices, give one for each or none");
  mesh = make_plane();
  mesh.positions[2].y = k_infinity;
  EXPECT_EQ(message(mesh), "knot: vertex 2 is not finite, mend the mesh");
  mesh = make_plane();
  mesh.triangles[1].z = 4;
  EXPECT_EQ(message(mesh), "knot: triangle 1 refers to vertex 4, but there are only 4");
  EXPECT_EQ(message({}), "knot: has no triangles, nothing to render");
}

struct Loading {
  uint64_t allocations = 0, bytes = 0;  // of load_mesh()
  uint64_t kept = 0;                    // by the file and the mesh
};

// Whatever a mesh's size, loading it takes the file, the mesh and no more: nothing for a record, and no array twice.
TEST_F(MeshIo, LoadsTwoMillionTrianglesInAsManyAllocationsAsFew) {
  const auto load_grid = [&](int side) {
    save_ply(path("grid.ply"), make_plane({.half_size = 1.0f, .columns = side, .rows = side}));
    const uint64_t count = allocation_count, bytes = allocation_bytes;
    const TriangleMesh mesh = load_mesh(path("grid.ply"));
    Loading loading = {allocation_count - count, allocation_bytes - bytes, fs::file_size(path("grid.ply"))};
    EXPECT_EQ(mesh.triangles.size(), size_t(2 * side * side));
    EXPECT_EQ(mesh.positions.size(), size_t((side + 1) * (side + 1)));
    loading.kept += mesh.positions.size() * sizeof(Vec3) + mesh.normals.size() * sizeof(Vec3) +
                    mesh.texcoords.size() * sizeof(Vec2) + mesh.triangles.size() * sizeof(UVec3);
    return loading;
  };
  const Loading few = load_grid(100), many = load_grid(1000);
  EXPECT_LE(many.allocations, few.allocations);
  // One bit a vertex tells which are used.
  EXPECT_LE(many.bytes - many.kept, few.bytes - few.kept + 1001 * 1001 / 8);
}

TEST_F(MeshIo, ReadsTheBunnyWhereItIsInstalled) {
  const std::string bunny = "/usr/share/glmark2/models/bunny.obj";
  if (!fs::exists(bunny)) GTEST_SKIP() << "glmark2-data is not installed";
  const TriangleMesh mesh = load_mesh(bunny);
  EXPECT_EQ(mesh.triangles.size(), 69666u);
  EXPECT_EQ(mesh.positions.size(), 34835u);
}

// Truncated, altered, duplicated and spliced files: the loader always returns a sound mesh or throws Error.
TEST_F(MeshIo, NothingButErrorLeavesTheLoader) {
  const std::string obj =
      k_square + "vt 0 0\nvt 1 0\nvn 0 0 1\nf 1/1/1 2/2/1 3/2/1 4/1/1\nf -4//-1 -2//1 -1//1\nf 1 2 \\\n3\n";
  const std::string ascii = k_ply_head + k_ply_vertices + "3 0 1 2\n3 0 2 3\n";
  const std::vector<std::pair<std::string, std::string>> seeds = {{"f.obj", obj},
                                                                  {"f.ply", ascii},
                                                                  {"f.ply", exotic_ply("ascii")},
                                                                  {"f.ply", exotic_ply("binary_little_endian")},
                                                                  {"f.ply", exotic_ply("binary_big_endian")}};
  const std::vector<std::string> words = {"nan",
                                          "-1",
                                          "0",
                                          "99999999999999999999",
                                          "1e999",
                                          "/",
                                          "//",
                                          "\\\n",
                                          "\r",
                                          "\n",
                                          "list",
                                          "element vertex 7\n",
                                          "v ",
                                          "f ",
                                          "vn 1\n",
                                          std::string(1, '\0'),
                                          "\xff\xff\xff\xff",
                                          ".",
                                          "-",
                                          "2147483648"};
  std::mt19937 rng(2024);
  const auto below = [&](size_t n) { return size_t(rng()) % n; };
  int loaded = 0, refused = 0;
  for (int round = 0; round < 3000; ++round) {
    const auto& [name, seed] = seeds[size_t(round) % seeds.size()];
    std::string bytes = seed;
    for (size_t changes = 1 + below(3); changes > 0 && !bytes.empty(); --changes) {
      const size_t at = below(bytes.size());
      switch (below(6)) {
        case 0:
          bytes.resize(at);
          break;
        case 1:
          bytes[at] = char(rng());
          break;
        case 2:
          bytes[at] = char(bytes[at] ^ (1 << below(8)));
          break;
        case 3:
          bytes.insert(at, words[below(words.size())]);
          break;
        case 4:
          bytes.erase(at, 1 + below(8));
          break;
        default:
          bytes.insert(at, bytes.substr(below(bytes.size()), below(60)));
          break;
      }
    }
    try {
      const TriangleMesh mesh = load(name, bytes, {.compute_normals = true});
      ++loaded;
      ASSERT_TRUE(finite(mesh)) << round;
      ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
      ASSERT_FALSE(mesh.triangles.empty());
      for (const UVec3& t : mesh.triangles) ASSERT_LT(std::max({t.x, t.y, t.z}), mesh.positions.size());
    } catch (const Error& e) {
      ++refused;
      ASSERT_EQ(strip(e.what()).rfind(name, 0), 0u) << e.what();
    } catch (const std::exception& e) {
      FAIL() << "round " << round << ": " << e.what();
    }
  }
  EXPECT_GT(loaded, 50);
  EXPECT_GT(refused, 500);
}

}  // namespace
}  // namespace fieldtrace
