// Field files: reading returns what was written, and damaged bytes are refused.
#include "field/file/field_file.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <functional>
#include <iterator>
#include <random>
#include <set>

#include "field/file/field_info.h"
#include "tests/support/field_checks.h"

namespace fieldtrace {
namespace {

using test::differing_slices;
using test::TemporaryFolder;

constexpr FieldParameters k_small = {32, 64, 8};

std::string read_bytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

// The reason why a file is refused; empty if it loads.
std::string refusal(Field& field, const FieldIdentity& identity, const std::string& path) {
  try {
    load_field(field, identity, path);
    return {};
  } catch (const FieldFileError& e) {
    EXPECT_EQ(std::string(e.what()).rfind(path + ": ", 0), 0u) << e.what();
    return e.reason();
  }
}

TEST(Hash128, AgreesWithThePublishedVectors) {
  // XXH3_128bits with seed 0, as `xxhsum -H128` prints it.
  Hasher hasher;
  EXPECT_EQ(hasher.result().hex(), "99aa06d3014798d86001c324468d497f");
  hasher.add(nullptr, 0);
  hasher.add("abc", 3);
  EXPECT_EQ(hasher.result().hex(), "06b05ab6733a618578af5f94892f3950");
}

TEST(Hash128, DoesNotDependOnHowTheBytesAreCut) {
  std::mt19937 random(7);
  std::string bytes(1000, '\0');
  for (char& c : bytes) c = char(random());
  Hasher whole;
  whole.add(bytes.data(), bytes.size());
  for (int i = 0; i < 50; ++i) {
    Hasher parts;
    for (size_t at = 0; at < bytes.size();) {
      const size_t n = std::min<size_t>(random() % 40, bytes.size() - at);
      parts.add(bytes.data() + at, n);
      at += n;
    }
    EXPECT_EQ(parts.result(), whole.result());
  }
  Hash128 parsed;
  EXPECT_TRUE(parse_hash(whole.result().hex(), parsed));
  EXPECT_EQ(parsed, whole.result());
  EXPECT_FALSE(parse_hash("0123", parsed));
  EXPECT_FALSE(parse_hash("g0000000000000000000000000000000", parsed));
}

TEST(FieldIdentity, ChangesWithWhateverABakeDependsOn) {
  Shape shape;
  shape.mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  shape.mesh.triangles = {{0, 1, 2}, {0, 1, 3}};
  const FieldIdentity base = field_identity(shape, k_small);
  EXPECT_EQ(base.primitive_count, 2u);
  std::set<std::string> names = {base.file_name()};
  const auto expect_new = [&](const FieldIdentity& identity) {
    EXPECT_FALSE(identity == base);
    EXPECT_TRUE(names.insert(identity.file_name()).second);
  };
  Shape moved = shape;
  moved.mesh.positions[1].x = std::nextafter(1.0f, 2.0f);
  expect_new(field_identity(moved, k_small));
  Shape turned = shape;
  std::swap(turned.mesh.triangles[0], turned.mesh.triangles[1]);
  expect_new(field_identity(turned, k_small));
  for (const FieldParameters& p : {FieldParameters{64, 64, 8}, {32, 128, 8}, {32, 64, 9}}) {
    expect_new(field_identity(shape, p));
  }
  FieldIdentity other = base;
  other.chart = "another";
  expect_new(other);
  other = base;
  ++other.format_version;
  expect_new(other);
  for (const ShapeKind kind : {ShapeKind::sphere, ShapeKind::disk, ShapeKind::cylinder}) {
    Shape analytic;
    analytic.kind = kind;
    expect_new(field_identity(analytic, k_small));
  }
  // Shading and names do not matter.
  Shape shaded = shape;
  shaded.name = "other";
  shaded.mesh.normals.assign(4, Vec3(0, 0, 1));
  shaded.mesh.texcoords.assign(4, Vec2(0.5f));
  EXPECT_EQ(field_identity(shaded, k_small).file_name(), base.file_name());
}

TEST(FieldFile, RoundTripIsExactForEveryParameter) {
  const TemporaryFolder folder;
  for (const FieldParameters& parameters : {k_small, FieldParameters{64, 64, 16}, FieldParameters{32, 128, 32}}) {
    const FieldIdentity identity = test::test_identity(parameters);
    Field field(test::test_ball(), parameters);
    test::fill_random_slices(field, 1, 400);
    // Slices in the chart's corners.
    for (const FieldLayer layer : {FieldLayer::visibility, FieldLayer::depth, FieldLayer::primitive}) {
      test::fill_slice(field, layer, 0);
      test::fill_slice(field, layer, field.slice_count() - 1);
    }
    test::fill_miss_brick(field, 9, 3);
    save_field(field, identity, folder / "a.vdb");
    Field loaded(test::test_ball(), parameters);
    const auto [slices, whole] = load_field(loaded, identity, folder / "a.vdb");
    EXPECT_TRUE(whole);
    EXPECT_EQ(differing_slices(field, loaded), 0u);
    EXPECT_EQ(loaded.cells_baked(), field.cells_baked());
    EXPECT_EQ(loaded.bytes(), field.bytes());
    EXPECT_EQ(slices, slices_hash(field));
    EXPECT_EQ(slices, slices_hash(loaded));
  }
}

TEST(FieldFile, LoadingAddsToWhatAFieldHas) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field a(test::test_ball(), k_small), b(test::test_ball(), k_small), both(test::test_ball(), k_small);
  test::fill_random_slices(a, 1, 200);
  test::fill_random_slices(b, 2, 200);
  test::fill_random_slices(both, 1, 200);
  test::fill_random_slices(both, 2, 200);
  save_field(a, identity, folder / "a.vdb");
  ASSERT_GT(differing_slices(b, both), 50u);
  load_field(b, identity, folder / "a.vdb");
  EXPECT_EQ(differing_slices(b, both), 0u);
  const Field* const fields[] = {&a, &both};
  save_fields(fields, identity, folder / "union.vdb");
  Field loaded(test::test_ball(), k_small);
  load_field(loaded, identity, folder / "union.vdb");
  EXPECT_EQ(differing_slices(loaded, both), 0u);
}

// Whatever is left out, bricks or tiles, is told; what is there already takes no room.
TEST(FieldFile, LoadingTellsWhetherAFieldHasRoom) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  test::fill_random_slices(field, 1, 200);
  const uint64_t bricks = field.bytes();
  for (const uint32_t slot : {5u, 2000u}) {
    ASSERT_TRUE(field.coverage().claim(slot));
    ASSERT_TRUE(field.coverage().finish(slot, TileLines(CoverageTiles::k_lines_per_tile, 3)));
  }
  save_field(field, identity, folder / "all.vdb");
  for (const uint64_t room : {bricks / 2, bricks, field.bytes() - 1, field.bytes()}) {
    FieldBudget budget(room);
    Field loaded(test::test_ball(), k_small, &budget);
    EXPECT_EQ(load_field(loaded, identity, folder / "all.vdb").whole, room == field.bytes()) << room;
    save_field(loaded, identity, folder / "some.vdb");
    EXPECT_TRUE(load_field(loaded, identity, folder / "some.vdb").whole) << room;
  }
}

TEST(FieldFile, AnEmptyFieldIsAFileToo) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  save_field(field, identity, folder / "empty.vdb");
  load_field(field, identity, folder / "empty.vdb");
  EXPECT_EQ(field.cells_baked(), 0u);
}

TEST(FieldFile, ConstantBricksTakeNoSpace) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  const auto bytes_with = [&](uint32_t bricks) {
    Field field(test::test_ball(), k_small);
    for (uint32_t p = 0; p < bricks; ++p) test::fill_miss_brick(field, 5, p);
    save_field(field, identity, folder / "miss.vdb");
    Field loaded(test::test_ball(), k_small);
    load_field(loaded, identity, folder / "miss.vdb");
    EXPECT_EQ(differing_slices(field, loaded), 0u);
    return read_bytes(folder / "miss.vdb").size();
  };
  // A leaf takes its mask of 64 bytes at least.
  EXPECT_LT(bytes_with(128), bytes_with(1) + 127 * 16);
}

TEST(FieldFile, VdbPrintListsIt) {
  if (std::system("command -v vdb_print > /dev/null 2>&1") != 0) GTEST_SKIP() << "vdb_print is not installed";
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  // One slice of one brick: 32 active voxels in each grid.
  test::fill_slice(field, FieldLayer::visibility, 100);
  test::fill_slice(field, FieldLayer::depth, 100);
  test::fill_slice(field, FieldLayer::primitive, 100);
  save_field(field, identity, folder / "a.vdb");
  const auto output_of = [](const std::string& command) {
    std::string text;
    FILE* pipe = popen((command + " 2>&1").c_str(), "r");
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) text += char(c);
    return std::pair(pclose(pipe), text);
  };
  const auto [code, text] = output_of("vdb_print -l " + (folder / "a.vdb"));
  EXPECT_EQ(code, 0) << text;
  for (const char* word : {"visibility", "depth_normal", "certificate", "primitive", "int32", "directions", "plane",
                           "lines", "centre", "radius", "orthographic", "fieldtrace_format", "mesh_hash"}) {
    EXPECT_NE(text.find(word), std::string::npos) << word << " in\n" << text;
  }
  const auto [short_code, short_text] = output_of("vdb_print " + (folder / "a.vdb"));
  EXPECT_EQ(short_code, 0);
  EXPECT_NE(short_text.find("32Vox"), std::string::npos) << short_text;
}

TEST(FieldFile, RefusesAnotherMeshAndOtherParameters) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  test::fill_random_slices(field, 3, 100);
  save_field(field, identity, folder / "a.vdb");
  const auto expect_refused = [&](const FieldIdentity& wanted, const Sphere& ball, const char* word) {
    Field target(ball, wanted.parameters);
    EXPECT_NE(refusal(target, wanted, folder / "a.vdb").find(word), std::string::npos) << word;
    EXPECT_EQ(target.cells_baked(), 0u);
    EXPECT_TRUE(target.bricks().empty());
  };
  FieldIdentity other = identity;
  other.geometry.low ^= 1;
  expect_refused(other, test::test_ball(), "another mesh");
  other = identity;
  other.parameters.lines = 9;
  expect_refused(other, test::test_ball(), "parameters");
  other = identity;
  other.parameters.plane = 128;
  expect_refused(other, test::test_ball(), "parameters");
  Sphere ball = test::test_ball();
  ball.radius = std::nextafter(ball.radius, 9.0f);
  expect_refused(identity, ball, "sphere");
  // The file's own header says what it is.
  EXPECT_EQ(FieldFile(folder / "a.vdb").header().identity, identity);
  EXPECT_EQ(FieldFile(folder / "a.vdb").header().ball.radius, test::test_ball().radius);
}

TEST(FieldFile, RefusesCellsThatNoBakeWrites) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  const auto reason_for = [&](const std::function<void(Field&, uint32_t)>& write, FieldLayer layer) {
    Field field(test::test_ball(), k_small), target(test::test_ball(), k_small);
    test::fill_slice(field, layer, 100);
    write(field, (field.brick_at(0, 100) * 512 + 32 * (100 / uint32_t(field.view().plane_bricks))) + 5);
    save_field(field, identity, folder / "odd.vdb");
    const std::string reason = refusal(target, identity, folder / "odd.vdb");
    EXPECT_EQ(target.bricks().empty(), !reason.empty());
    return reason;
  };
  const uint32_t plane_fit = encode_certificate(scalar::k_kind_plane_fit, 0, 0);
  const auto set_visibility = [](uint8_t code) {
    return [code](Field& f, uint32_t cell) { f.store_visibility(cell, code); };
  };
  const auto set_plane_fit = [](uint32_t certificate) {
    return [=](Field& f, uint32_t cell) { f.store_plane_fit(cell, 1, certificate); };
  };
  const auto set_primitive = [](uint32_t primitive) {
    return [=](Field& f, uint32_t cell) { f.store_primitive(cell, primitive); };
  };
  EXPECT_EQ(reason_for(set_visibility(32), FieldLayer::visibility), "");
  EXPECT_NE(reason_for(set_visibility(33), FieldLayer::visibility), "");
  EXPECT_NE(reason_for(set_visibility(0), FieldLayer::visibility), "");
  EXPECT_EQ(reason_for(set_primitive(test::k_test_primitives - 1), FieldLayer::primitive), "");
  EXPECT_EQ(reason_for(set_primitive(k_none), FieldLayer::primitive), "");
  EXPECT_NE(reason_for(set_primitive(test::k_test_primitives), FieldLayer::primitive), "");
  EXPECT_EQ(reason_for(set_plane_fit(plane_fit), FieldLayer::depth), "");
  EXPECT_NE(reason_for(set_plane_fit(0), FieldLayer::depth), "");
  EXPECT_EQ(reason_for(set_plane_fit(scalar::k_kind_one_sided), FieldLayer::depth), "");
  EXPECT_NE(reason_for(set_plane_fit(plane_fit | 16 << 2), FieldLayer::depth), "");
  EXPECT_NE(reason_for(set_plane_fit(plane_fit | 1 << 16), FieldLayer::depth), "");
}

TEST(FieldFile, DamageIsFoundAndLeavesTheFieldAsItWas) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  test::fill_random_slices(field, 4, 300);
  save_field(field, identity, folder / "whole.vdb");
  const std::string whole = read_bytes(folder / "whole.vdb");
  Field target(test::test_ball(), k_small);
  const auto expect_refused = [&](const std::string& bytes, const std::string& what) {
    write_bytes(folder / "bad.vdb", bytes);
    EXPECT_NE(refusal(target, identity, folder / "bad.vdb"), "") << what;
    EXPECT_EQ(target.cells_baked(), 0u) << what;
  };
  for (int i = 0; i < 50; ++i) {
    const size_t length = whole.size() * size_t(i) / 50;
    expect_refused(whole.substr(0, length), "cut at " + std::to_string(length));
  }
  expect_refused(whole.substr(0, whole.size() - 1), "last byte gone");
  expect_refused(whole + "x", "a byte too many");
  expect_refused(std::string(100, '\0'), "zeros");
  expect_refused("not a field", "text");
  std::mt19937 random(11);
  for (int i = 0; i < 200; ++i) {
    std::string bytes = whole;
    // The ends, which hold header and trailer, as often as the middle.
    const size_t span = i % 2 == 0 ? bytes.size() : 64;
    size_t at = random() % span;
    if (i % 4 == 1) at = bytes.size() - 1 - at;
    bytes[at] = char(bytes[at] ^ (1 << random() % 8));
    expect_refused(bytes, "bit of byte " + std::to_string(at));
  }
  EXPECT_NE(refusal(target, identity, folder / "missing.vdb"), "");
  EXPECT_NE(refusal(target, identity, folder.path()), "");
  load_field(target, identity, folder / "whole.vdb");
  EXPECT_EQ(differing_slices(field, target), 0u);
}

TEST(FieldFile, TellsOfOtherFormatVersions) {
  const TemporaryFolder folder;
  FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small), target(test::test_ball(), k_small);
  test::fill_random_slices(field, 4, 20);
  const auto expect_told = [&](const std::string& file, const std::string& version) {
    const std::string reason = refusal(target, test::test_identity(k_small), file);
    EXPECT_NE(reason.find("has field format version " + version + ","), std::string::npos) << reason;
    EXPECT_EQ(target.cells_baked(), 0u);
  };
  // By the file's metadata.
  for (const int version : {k_field_format_version - 1, k_field_format_version + 1}) {
    identity.format_version = version;
    save_field(field, identity, folder / "metadata.vdb");
    expect_told(folder / "metadata.vdb", std::to_string(version));
  }
  // By the trailer, whose hash was another up to version 7: such a file is old, and not damaged.
  save_field(field, test::test_identity(k_small), folder / "whole.vdb");
  std::string bytes = read_bytes(folder / "whole.vdb");
  bytes[bytes.size() - 25] = 1;
  bytes[bytes.size() - 1] = char(bytes[bytes.size() - 1] ^ 1);
  write_bytes(folder / "trailer.vdb", bytes);
  expect_told(folder / "trailer.vdb", "7 or earlier");
  bytes[bytes.size() - 25] = char(k_field_format_version + 1);
  write_bytes(folder / "trailer.vdb", bytes);
  expect_told(folder / "trailer.vdb", std::to_string(k_field_format_version + 1));
}

TEST(FieldFile, RefusesOtherFilesBehindAValidChecksum) {
  const TemporaryFolder folder;
  const auto sealed = [](std::string body) {
    Hasher hasher;
    hasher.add(body.data(), body.size());
    const Hash128 hash = hasher.result();
    const uint64_t words[] = {body.size(), hash.high, hash.low};
    body += "FTFIELD";
    body += char(k_field_format_version);
    for (const uint64_t word : words) {
      for (int i = 0; i < 8; ++i) body += char(word >> (8 * i));
    }
    return body;
  };
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  test::fill_random_slices(field, 4, 20);
  save_field(field, identity, folder / "whole.vdb");
  const std::string whole = read_bytes(folder / "whole.vdb");
  ASSERT_EQ(sealed(whole.substr(0, whole.size() - 32)), whole);
  Field target(test::test_ball(), k_small);
  write_bytes(folder / "text.vdb", sealed("no OpenVDB file"));
  EXPECT_NE(refusal(target, identity, folder / "text.vdb").find("OpenVDB"), std::string::npos);
  EXPECT_EQ(target.cells_baked(), 0u);
}

TEST(FieldFile, AnUnwritableFileIsAnError) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  const Field field(test::test_ball(), k_small);
  EXPECT_THROW(save_field(field, identity, folder / "no/such/folder.vdb"), Error);
  EXPECT_THROW(save_field(field, identity, folder.path()), Error);
}

TEST(FieldInfo, CountsCells) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field(test::test_ball(), k_small);
  test::fill_slice(field, FieldLayer::visibility, 3);  // a multiple of 3: certified misses
  test::fill_slice(field, FieldLayer::visibility, 4);
  test::fill_slice(field, FieldLayer::depth, 6);
  save_field(field, identity, folder / "a.vdb");
  const FieldFileInfo info = field_info(folder / "a.vdb");
  EXPECT_EQ(info.header.identity, identity);
  EXPECT_EQ(info.bytes_disk, read_bytes(folder / "a.vdb").size());
  EXPECT_EQ(info.cells_full, uint64_t(32 * 32 * 64 * 64));
  EXPECT_EQ(info.visibility.cells_baked, 64u);
  EXPECT_EQ(info.visibility.clear + info.visibility.blocked + info.visibility.undecided, 64u);
  EXPECT_GE(info.visibility.clear, 32u);
  EXPECT_GT(info.visibility.undecided, 0u);
  EXPECT_EQ(info.depth.cells_baked, 32u);
  EXPECT_EQ(info.depth.clear, 32u);
  EXPECT_EQ(field_info(folder / "a.vdb", 0.0f).visibility.undecided, 64u);
  EXPECT_EQ(field_info(folder / "a.vdb", 1.0f).visibility.undecided, 0u);
}

}  // namespace
}  // namespace fieldtrace
