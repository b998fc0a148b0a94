// The cache: stores merge, damage is told about and repaired, concurrent renders lose nothing.
#include "field/field_cache.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "field/field_file.h"
#include "field_checks.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;
using test::differing_slices;
using test::TemporaryFolder;

constexpr FieldParameters k_small = {32, 64, 8};

Field make_field() { return Field(test::test_ball(), k_small); }

struct Warnings {
  std::vector<std::string> lines;
  WarningSink sink() {
    return [this](const std::string& line) { lines.push_back(line); };
  }
};

TEST(FieldCache, KeepsWhatIsStored) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Warnings warnings;
  FieldCache cache(folder / "a/b", warnings.sink());
  Field field = make_field(), loaded = make_field();
  EXPECT_FALSE(cache.load(loaded, identity));
  EXPECT_EQ(cache.bytes_on_disk(identity), 0u);
  test::fill_random_slices(field, 1, 100);
  cache.store(field, identity);
  EXPECT_EQ(cache.bytes_on_disk(identity), fs::file_size(cache.path_of(identity)));
  EXPECT_EQ(fs::path(cache.path_of(identity)).filename(), identity.file_name());
  EXPECT_TRUE(FieldCache(folder / "a/b").load(loaded, identity));
  EXPECT_EQ(differing_slices(field, loaded), 0u);
  EXPECT_TRUE(warnings.lines.empty());
}

TEST(FieldCache, AnEmptyFieldIsNotStored) {
  const TemporaryFolder folder;
  FieldCache cache(folder.path());
  Field field = make_field();
  cache.store(field, test::test_identity(k_small));
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(FieldCache, StoresMerge) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field a = make_field(), b = make_field(), both = make_field(), loaded = make_field();
  test::fill_random_slices(a, 1, 200);
  test::fill_random_slices(b, 2, 200);
  test::fill_random_slices(both, 1, 200);
  test::fill_random_slices(both, 2, 200);
  FieldCache first(folder.path()), second(folder.path());
  first.store(a, identity);
  second.store(b, identity);
  EXPECT_TRUE(first.load(loaded, identity));
  EXPECT_EQ(differing_slices(loaded, both), 0u);
}

TEST(FieldCache, WritesOnlyWhatIsNew) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field = make_field();
  test::fill_random_slices(field, 1, 100);
  FieldCache cache(folder.path());
  cache.store(field, identity);
  // Every file that OpenVDB writes has an identifier of its own, so equal bytes are the same file.
  const auto contents = [&] {
    std::ifstream in(cache.path_of(identity), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  const std::string before = contents();
  cache.store(field, identity);
  EXPECT_EQ(contents(), before);
  FieldCache other(folder.path());
  other.store(field, identity);
  EXPECT_EQ(contents(), before);
  Field loaded = make_field();
  EXPECT_TRUE(other.load(loaded, identity));
  other.store(loaded, identity);
  EXPECT_EQ(contents(), before);
  test::fill_slice(loaded, FieldLayer::depth, loaded.slice_count() / 2);
  other.store(loaded, identity);
  EXPECT_NE(contents(), before);
  fs::remove(cache.path_of(identity));
  cache.store(field, identity);
  EXPECT_TRUE(fs::exists(cache.path_of(identity)));
}

// A field with slices of its own that then loads a file must not be taken to be the file.
TEST(FieldCache, LoadingIntoABakedFieldStillStoresItsSlices) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field a = make_field(), b = make_field(), loaded = make_field();
  test::fill_random_slices(a, 1, 100);
  test::fill_random_slices(b, 2, 100);
  FieldCache cache(folder.path());
  cache.store(a, identity);
  EXPECT_TRUE(cache.load(b, identity));
  cache.store(b, identity);
  EXPECT_TRUE(cache.load(loaded, identity));
  EXPECT_EQ(differing_slices(loaded, b), 0u);
}

TEST(FieldCache, DamagedAndForeignFilesAreToldAboutAndReplaced) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Warnings warnings;
  FieldCache cache(folder.path(), warnings.sink());
  Field field = make_field();
  test::fill_random_slices(field, 1, 100);
  FieldIdentity foreign = identity;
  foreign.geometry.high ^= 1;
  const auto spoil = [&](const std::function<void(const std::string&)>& how, const char* word) {
    cache.store(field, identity);
    how(cache.path_of(identity));
    Field loaded = make_field();
    warnings.lines.clear();
    EXPECT_FALSE(cache.load(loaded, identity));
    EXPECT_EQ(loaded.cells_baked(), 0u);
    ASSERT_EQ(warnings.lines.size(), 1u);
    EXPECT_EQ(warnings.lines[0].rfind(cache.path_of(identity) + ": ", 0), 0u) << warnings.lines[0];
    EXPECT_NE(warnings.lines[0].find(word), std::string::npos) << warnings.lines[0];
    EXPECT_NE(warnings.lines[0].find("baked again"), std::string::npos) << warnings.lines[0];
    // A fresh process, which has baked again.
    FieldCache fresh(folder.path());
    fresh.store(field, identity);
    EXPECT_TRUE(fresh.load(loaded, identity));
    EXPECT_EQ(differing_slices(loaded, field), 0u);
  };
  spoil([](const std::string& path) { fs::resize_file(path, fs::file_size(path) / 2); }, "cut short");
  spoil([](const std::string& path) { fs::resize_file(path, 0); }, "cut short");
  spoil(
      [](const std::string& path) {
        std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
        file.seekp(300);
        file.put('?');
      },
      "damaged");
  spoil([&](const std::string& path) { save_field(field, foreign, path); }, "another mesh");
}

TEST(FieldCache, ConcurrentStoresLoseNothing) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  constexpr uint32_t k_writers = 4, k_rounds = 3;
  Warnings warnings;
  std::vector<std::thread> writers;
  for (uint32_t w = 0; w < k_writers; ++w) {
    writers.emplace_back([&, w] {
      FieldCache cache(folder.path(), [&](const std::string& line) { ADD_FAILURE() << line; });
      for (uint32_t round = 0; round < k_rounds; ++round) {
        Field field = make_field();
        cache.load(field, identity);
        test::fill_random_slices(field, 100 * w + round, 60);
        cache.store(field, identity);
      }
    });
  }
  for (std::thread& t : writers) t.join();
  Field expected = make_field(), loaded = make_field();
  for (uint32_t w = 0; w < k_writers; ++w) {
    for (uint32_t round = 0; round < k_rounds; ++round) test::fill_random_slices(expected, 100 * w + round, 60);
  }
  EXPECT_TRUE(FieldCache(folder.path()).load(loaded, identity));
  EXPECT_EQ(differing_slices(loaded, expected), 0u);
  for (const auto& entry : fs::directory_iterator(folder.path())) EXPECT_NE(entry.path().extension(), ".tmp");
}

// A field that is being baked while it is stored: the file holds whole slices only.
TEST(FieldCache, StoringWhileBakingKeepsWholeSlices) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  FieldCache cache(folder.path());
  Field field = make_field();
  test::fill_random_slices(field, 1, 20);
  std::thread baker([&] { test::fill_random_slices(field, 2, 2000); });
  for (int i = 0; i < 3; ++i) cache.store(field, identity);
  baker.join();
  Field loaded = make_field();
  EXPECT_TRUE(cache.load(loaded, identity));
  cache.store(field, identity);
  Field complete = make_field();
  EXPECT_TRUE(cache.load(complete, identity));
  EXPECT_EQ(differing_slices(complete, field), 0u);
}

TEST(FieldCache, AFolderThatCannotBeWrittenIsAnError) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  EXPECT_THROW(FieldCache(folder / "file"), Error);
  EXPECT_THROW(FieldCache(folder / "file/below"), Error);
  // Gone since the cache was made.
  const FieldIdentity identity = test::test_identity(k_small);
  FieldCache cache(folder / "gone");
  Field field = make_field();
  test::fill_slice(field, FieldLayer::depth, 1);
  fs::remove_all(folder / "gone");
  EXPECT_THROW(cache.store(field, identity), Error);
}

}  // namespace
}  // namespace fieldtrace
