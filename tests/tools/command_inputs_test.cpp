// What commands read: regular files only, with memory in proportion to their size.
#include <sys/stat.h>

#include "field/file/field_file.h"
#include "field/file/hash.h"
#include "tests/support/command_files.h"

namespace fieldtrace::test {
namespace {

namespace fs = std::filesystem;

class CommandInputs : public CommandFiles {
 protected:
  // SIGALRM ends a program that blocks or reads without end.
  static void only_seconds() { alarm(10); }

  void make_special(const std::string& name, bool pipe) const {
    fs::remove(folder_ / name);
    if (pipe) {
      ASSERT_EQ(mkfifo((folder_ / name).c_str(), 0600), 0);
    } else {
      fs::create_symlink("/dev/zero", folder_ / name);
    }
  }
};

TEST_F(CommandInputs, DevicesAndPipesAreRefused) {
  ASSERT_EQ(run({"render", "scene.xml", "-o", "a.exr", "--quiet"}).code, 0);
  for (const bool pipe : {false, true}) {
    for (const char* name : {"x.xml", "x.ply", "x.obj", "x.png", "x.exr", "x.vdb", "x"}) {
      make_special(name, pipe);
      expect_failure(1, std::string(name) + ": is not a regular file", {"info", name}, only_seconds);
    }
    expect_failure(1, "x.xml: is not a regular file", {"render", "x.xml", "-o", "b.exr", "--quiet"}, only_seconds);
    expect_failure(1, "x.exr: is not a regular file", {"compare", "a.exr", "x.exr"}, only_seconds);
    expect_failure(1, "x.exr: is not a regular file", {"compare", "x.exr", "a.exr"}, only_seconds);
    expect_failure(1, "x.ply: is not a regular file", {"bake", "x.ply", "-o", "b.vdb", "--full"}, only_seconds);
  }
}

TEST_F(CommandInputs, DevicesAndPipesInScenesAreRefusedWithTheirLine) {
  const char* const elements[] = {R"(<include filename="x"/>)",
                                  R"(<shape type="ply"><string name="filename" value="x"/></shape>)",
                                  R"(<emitter type="envmap"><string name="filename" value="x"/></emitter>)",
                                  R"(<shape type="cube"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
         <string name="filename" value="x"/></texture></bsdf></shape>)"};
  for (const bool pipe : {false, true}) {
    make_special("x", pipe);
    for (const char* element : elements) {
      write("uses.xml", std::string("<scene version=\"3.0.0\">\n") + element + "\n</scene>\n");
      expect_failure(1, "uses.xml:2: '", {"render", "uses.xml", "-o", "b.exr", "--quiet"}, only_seconds);
      expect_failure(1, "is not a regular file", {"render", "uses.xml", "-o", "b.exr", "--quiet"}, only_seconds);
    }
  }
}

TEST_F(CommandInputs, IncludesThatMultiplyAreRefused) {
  // Level 0 would read 10^12 files.
  for (int level = 0; level < 12; ++level) {
    std::string text = "<scene version=\"3.0.0\">\n";
    for (int i = 0; i < 10; ++i) text += "<include filename=\"level" + std::to_string(level + 1) + ".xml\"/>\n";
    write("level" + std::to_string(level) + ".xml", text + "</scene>\n");
  }
  write("level12.xml", "<scene version=\"3.0.0\"/>\n");
  // The first 10,000 files read reach the last level, so the error is reported in an include of level 11.
  expect_failure(1, "level11.xml:", {"info", "level0.xml"}, [] { alarm(60); });
  expect_failure(1, "the scene includes more than 10000 files", {"info", "level0.xml"}, [] { alarm(60); });
}

TEST_F(CommandInputs, ScenesOfTooManyBytesAreRefused) {
  write("big.xml", "<scene version=\"3.0.0\">\n");
  fs::resize_file(folder_ / "big.xml", (uintmax_t(1) << 30) + 1);  // a sparse file
  expect_failure(1, "big.xml: the scene's files have more than 1024 MiB", {"info", "big.xml"}, only_seconds);
  write("uses.xml", "<scene version=\"3.0.0\">\n\n<include filename=\"big.xml\"/></scene>\n");
  expect_failure(1, "uses.xml:3: the scene's files have more than 1024 MiB", {"info", "uses.xml"}, only_seconds);
}

TEST_F(CommandInputs, FilesLargerThanTheMemoryAreRefused) {
  for (const char* name : {"huge.ply", "huge.obj", "huge.png", "huge.vdb"}) {
    write(name, "");
    fs::resize_file(folder_ / name, uintmax_t(1) << 43);  // a sparse file
    expect_failure(1, std::string(name) + ": is larger than the memory of this machine", {"info", name}, only_seconds);
    fs::remove(folder_ / name);
  }
}

// ---- forged fields with a valid checksum

constexpr uint64_t k_little_memory = 300'000'000;
#ifdef __SANITIZE_ADDRESS__
constexpr uint64_t k_quarantine = uint64_t(256) << 20;  // freed memory that the sanitizer holds back by default
#else
constexpr uint64_t k_quarantine = 0;
#endif

std::string sealed(std::string body) {
  Hasher hasher;
  hasher.add(body.data(), body.size());
  const Hash128 hash = hasher.result();
  const uint64_t words[] = {body.size(), hash.high, hash.low};
  body += "FTFIELD" + std::string(1, char(k_field_format_version));
  for (const uint64_t word : words) {
    for (int i = 0; i < 8; ++i) body += char(word >> (8 * i));
  }
  return body;
}

TEST_F(CommandInputs, AFieldCannotAskForMoreMemoryThanItsSizeIsWorth) {
  constexpr FieldParameters p = {32, 64, 8};
  {
    Field field(test_ball(), p);
    fill_random_slices(field, 1, 100);
    save_field(field, test_identity(p), folder_ / "whole.vdb");
  }
  const std::string whole = read_text(folder_ / "whole.vdb");
  const std::string body = whole.substr(0, whole.size() - 32);
  ASSERT_TRUE(sealed(body) == whole) << "the trailer has changed";
  // Strings are a four-byte length and the text; a value is preceded by a name, a type and a length.
  const auto string_of = [](const std::string& text) {
    std::string bytes(4, '\0');
    bytes[0] = char(text.size());
    return bytes + text;
  };
  const auto expect_refused = [&](const std::string& what, size_t at, uint32_t length) {
    ASSERT_NE(at, std::string::npos) << what;
    std::string forged = body;
    for (size_t i = 0; i < 4; ++i) forged[at + i] = char(length >> (8 * i));
    write("forged.vdb", sealed(forged));
    const Outcome o = run({"info", "forged.vdb"}, only_seconds);
    EXPECT_EQ(o.code, 1) << what << ": " << o.err;
    EXPECT_NE(o.err.find("is not a field that OpenVDB can read"), std::string::npos) << what << ": " << o.err;
    EXPECT_LT(o.peak_bytes, k_little_memory + k_quarantine) << what;
  };
  const std::string chart = string_of("chart") + string_of("string"), grid = string_of("visibility");
  const size_t metadata = body.find(chart), descriptor = body.find(grid);
  expect_refused("a value's length", metadata + chart.size(), 0xfffffff0u);
  expect_refused("a name's length", metadata, 0xfffffff0u);
  expect_refused("a grid's name", descriptor, 0xfffffff0u);
  expect_refused("a grid's type", descriptor + grid.size(), 0xfffffff0u);
  expect_refused("the number of grids", descriptor - 4, 0x7fffffffu);
  // OpenVDB allocates as much memory for this type as the file claims.
  const std::string delayed_type = string_of("__delayedload");
  std::string forged =
      body.substr(0, metadata) + string_of("chart") + delayed_type + body.substr(metadata + chart.size());
  write("forged.vdb", sealed(forged));
  expect_failure(1, "metadata of the type __delayedload", {"info", "forged.vdb"}, only_seconds);
}

TEST_F(CommandInputs, ASmallFileOfManyEqualBricksTakesLittleMemory) {
  constexpr FieldParameters p = {64, 128, 8};
  {
    // All misses: 600 MB of cells.
    Field field(test_ball(), p);
    for (uint32_t slice = 0; slice < field.slice_count(); ++slice) {
      const auto seen = field.claim(FieldLayer::visibility, slice), deep = field.claim(FieldLayer::depth, slice);
      ASSERT_TRUE(seen && deep);
      for (uint32_t i = 0; i < uint32_t(scalar::k_slice_cells); ++i) {
        field.store_visibility(*seen + i, encode_visibility(false, 0));
        field.store_plane_fit(*deep + i, 0, encode_certificate(scalar::k_kind_miss, 0, 255));
      }
      field.finish(FieldLayer::visibility, slice);
      field.finish(FieldLayer::depth, slice);
    }
    EXPECT_GT(field.bytes(), 2 * k_little_memory);
    save_field(field, test_identity(p), folder_ / "misses.vdb");
  }
  EXPECT_LT(fs::file_size(folder_ / "misses.vdb"), 1'000'000u);
  const Outcome o = run({"info", "misses.vdb"});
  EXPECT_EQ(o.code, 0) << o.err;
  EXPECT_NE(o.out.find("visibility 67108864 of 67108864 cells (100.00 %)"), std::string::npos) << o.out;
  EXPECT_NE(o.out.find("131072 bricks"), std::string::npos) << o.out;
  EXPECT_LT(o.peak_bytes, k_little_memory + k_quarantine);
}

}  // namespace
}  // namespace fieldtrace::test
