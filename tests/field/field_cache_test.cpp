// The cache: stores merge, damage causes a warning and is repaired, concurrent renders lose nothing.
#include "field/file/field_cache.h"

#include <gtest/gtest.h>

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "core/io/atomic_file.h"
#include "core/io/file_lock.h"
#include "core/platform/machine_memory.h"
#include "field/file/field_file.h"
#include "field/file/field_trailer.h"
#include "tests/support/field_checks.h"

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
  // OpenVDB gives every file a new identifier, so equal bytes mean that the file was not rewritten.
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

// Loading a file into a field that has slices of its own must not make the field count as stored.
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
    // As a new process would, which has baked again.
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
  FieldIdentity earlier = identity;
  --earlier.format_version;
  spoil([&](const std::string& path) { save_field(field, earlier, path); }, "field format version");
}

// Their names hold another hash, so no field looks for them.
TEST(FieldCache, FilesOfEarlierFormatsAreToldAboutAndBakedAgain) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Warnings warnings;
  Field field = make_field(), loaded = make_field();
  test::fill_random_slices(field, 1, 100);
  const std::string old_file = folder / (std::string(32, 'a') + ".vdb");
  save_field(field, identity, old_file);
  EXPECT_FALSE(FieldCache(folder.path(), warnings.sink()).load(loaded, identity));
  EXPECT_TRUE(warnings.lines.empty());  // of today's format: another object's
  std::fstream(old_file, std::ios::binary | std::ios::in | std::ios::out).seekp(-25, std::ios::end).put(1);

  FieldCache cache(folder.path(), 1, warnings.sink());
  ASSERT_EQ(warnings.lines.size(), 1u);
  EXPECT_EQ(warnings.lines[0].rfind(folder.path() + ": holds 1 field file (", 0), 0u) << warnings.lines[0];
  EXPECT_NE(warnings.lines[0].find(std::to_string(fs::file_size(old_file)) + " bytes"), std::string::npos);
  EXPECT_NE(warnings.lines[0].find("baked again"), std::string::npos);
  EXPECT_FALSE(cache.load(loaded, identity));
  cache.store(field, identity);
  EXPECT_TRUE(cache.load(loaded, identity));
  EXPECT_EQ(differing_slices(loaded, field), 0u);
  // The limit counts and removes the old file.
  EXPECT_TRUE(fs::exists(old_file));
  cache.trim();
  EXPECT_FALSE(fs::exists(old_file));
  EXPECT_TRUE(fs::exists(cache.path_of(identity)));
}

TEST(FieldCache, ADamagedFileIsToldAboutOnce) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Field field = make_field(), loaded = make_field();
  test::fill_random_slices(field, 1, 100);
  FieldCache(folder.path()).store(field, identity);
  Warnings warnings;
  FieldCache cache(folder.path(), warnings.sink());
  fs::resize_file(cache.path_of(identity), 100);
  EXPECT_FALSE(cache.load(loaded, identity));
  cache.store(field, identity);  // which reads the file again
  EXPECT_EQ(warnings.lines.size(), 1u);
  EXPECT_TRUE(cache.load(loaded, identity));
  // A damaged file that only store() meets causes a warning, too.
  warnings.lines.clear();
  FieldCache other(folder.path(), warnings.sink());
  fs::resize_file(cache.path_of(identity), 100);
  other.store(field, identity);
  EXPECT_EQ(warnings.lines.size(), 1u);
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

TEST(FieldCache, StoresLaterInOrderAndTellsOfTheFirstFailure) {
  const TemporaryFolder folder;
  std::vector<int> done;
  {
    FieldCache cache(folder.path());
    cache.finish();  // nothing
    const auto later = [&](int i) { cache.store_later([&done, i] { done.push_back(i); }); };
    for (int i = 0; i < 50; ++i) later(i);
    cache.finish();
    EXPECT_EQ(done.size(), 50u);
    for (int i = 50; i < 100; ++i) later(i);
  }  // waits, too
  ASSERT_EQ(done.size(), 100u);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(done[size_t(i)], i);
  FieldCache cache(folder.path());
  cache.store_later([] { throw Error("no room"); });
  cache.store_later([&] { done.clear(); });
  EXPECT_THROW(cache.finish(), Error);
  EXPECT_EQ(done.size(), 100u);
}

// A field that is stored while it is baked: the file holds whole slices only.
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

// ---- the limit of size

class LimitedCache : public testing::Test {
 protected:
  // A file that was used `hours` ago.
  std::string add(uint64_t number, int hours) {
    const FieldIdentity identity = identity_of(number);
    FieldCache cache(folder_.path());
    Field field = make_field();
    test::fill_random_slices(field, uint32_t(number), 100);
    cache.store(field, identity);
    fs::last_write_time(cache.path_of(identity), fs::file_time_type::clock::now() - std::chrono::hours(hours));
    return cache.path_of(identity);
  }
  static FieldIdentity identity_of(uint64_t number) {
    FieldIdentity identity = test::test_identity(k_small);
    identity.geometry.low = number;
    return identity;
  }
  // Stores field 9 in a cache of this limit, as a render does.
  void store_and_trim(uint64_t most_bytes, uint64_t number = 9) {
    FieldCache cache(folder_.path(), most_bytes, warnings_.sink());
    Field field = make_field();
    test::fill_random_slices(field, uint32_t(number), 100);
    cache.store(field, identity_of(number));
    cache.trim();
  }

  const TemporaryFolder folder_;
  Warnings warnings_;
};

TEST_F(LimitedCache, TheLeastRecentlyUsedFilesGo) {
  const std::string a = add(1, 40), b = add(2, 50), c = add(3, 10), d = add(4, 30);
  const uint64_t some = fs::file_size(a) + fs::file_size(b) + fs::file_size(c) + fs::file_size(d);
  store_and_trim(some * 10);
  EXPECT_TRUE(fs::exists(a) && fs::exists(b) && fs::exists(c) && fs::exists(d));
  // Loading counts as use.
  FieldCache user(folder_.path());
  Field loaded = make_field();
  EXPECT_TRUE(user.load(loaded, identity_of(2)));
  const std::string e = FieldCache(folder_.path()).path_of(identity_of(9));
  store_and_trim(fs::file_size(b) + fs::file_size(c) + fs::file_size(e));
  EXPECT_FALSE(fs::exists(a));
  EXPECT_FALSE(fs::exists(d));
  EXPECT_TRUE(fs::exists(b) && fs::exists(c) && fs::exists(e));
  store_and_trim(fs::file_size(e) + fs::file_size(b));
  EXPECT_FALSE(fs::exists(c));
  EXPECT_TRUE(fs::exists(b) && fs::exists(e));
  EXPECT_TRUE(warnings_.lines.empty());
}

TEST_F(LimitedCache, FilesInUseStayAndAreToldAbout) {
  const std::string old = add(1, 40), used = add(2, 90);
  FieldCache cache(folder_.path(), 1, warnings_.sink());
  Field field = make_field();
  EXPECT_TRUE(cache.load(field, identity_of(2)));
  cache.trim();
  EXPECT_FALSE(fs::exists(old));
  EXPECT_TRUE(fs::exists(used));
  ASSERT_EQ(warnings_.lines.size(), 1u);
  EXPECT_NE(warnings_.lines[0].find("--field-cache-limit"), std::string::npos) << warnings_.lines[0];
}

TEST_F(LimitedCache, ForeignFilesAreNeitherCountedNorRemoved) {
  const std::string own = add(1, 40);
  const auto write = [&](const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    fs::last_write_time(folder_ / name, fs::file_time_type::clock::now() - std::chrono::hours(1000));
  };
  const std::string hex(32, 'a'), big(1 << 20, 'x');
  write("notes.txt", big);
  write("volume.vdb", big);
  write(hex + ".vdb", big);  // named like a field file, but not one
  write(hex + ".png", big);
  fs::copy_file(own, folder_ / "kept.vdb");  // a field under the user's own name
  fs::create_directory(folder_ / (std::string(32, 'b') + ".vdb"));
  const size_t before = size_t(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()));
  store_and_trim(1);
  EXPECT_FALSE(fs::exists(own));
  // One field with its lock and the folder's own lock were added, one field was removed.
  EXPECT_EQ(size_t(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator())), before + 2);
  warnings_.lines.clear();
  const std::string e = FieldCache(folder_.path()).path_of(identity_of(9));
  store_and_trim(fs::file_size(e));  // no warning: other files do not count
  EXPECT_TRUE(warnings_.lines.empty());
}

TEST_F(LimitedCache, HalfWrittenFilesOfKilledProcessesGo) {
  const auto write = [&](const std::string& name) {
    std::ofstream(folder_ / name) << "half";
    return folder_ / name;
  };
  const std::string abandoned = write(std::string(32, 'a') + ".vdb.1-0.tmp"), foreign = write("notes.txt.1-0.tmp"),
                    held = write(std::string(32, 'b') + ".vdb.1-0.tmp");
  const FileLock writer(folder_ / (std::string(32, 'b') + ".vdb.lock"));
  add(1, 40);
  store_and_trim(1);
  EXPECT_FALSE(fs::exists(abandoned));
  EXPECT_TRUE(fs::exists(foreign));
  EXPECT_TRUE(fs::exists(held));
}

TEST_F(LimitedCache, AFolderWithinMayHaveAnyName) {
  fs::create_directory(folder_ / "fields");
  EXPECT_TRUE(fs::exists(add(1, 40)));
}

TEST_F(LimitedCache, AFileThatIsBeingWrittenStays) {
  const std::string a = add(1, 40), b = add(2, 30);
  const FileLock writer(a + ".lock");
  store_and_trim(1);
  EXPECT_TRUE(fs::exists(a));
  EXPECT_FALSE(fs::exists(b));
}

TEST_F(LimitedCache, OfManyWhoStoreAndTrimAtOnceNoneFails) {
  // Room for more than one file: otherwise two threads that trim at once may each remove the other's.
  const uint64_t k_limit = 2 * fs::file_size(add(1, 60));
  std::vector<std::thread> threads;
  for (uint64_t t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (uint64_t round = 0; round < 4; ++round) {
        FieldCache cache(folder_.path(), k_limit, [](const std::string&) {});
        Field field = make_field(), loaded = make_field();
        test::fill_random_slices(field, uint32_t(10 * t + round), 60);
        cache.store(field, identity_of((t + round) % 5));
        cache.trim();
        // Either removed by another thread, or whole.
        Warnings warnings;
        FieldCache reader(folder_.path(), warnings.sink());
        reader.load(loaded, identity_of((t + round + 1) % 5));
        EXPECT_TRUE(warnings.lines.empty()) << warnings.lines[0];
      }
    });
  }
  for (std::thread& t : threads) t.join();
  uint64_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_NE(entry.path().extension(), ".tmp");
    if (entry.path().extension() == ".vdb") bytes += entry.file_size();
  }
  EXPECT_GT(bytes, 0u);
}

// As trimming does between the moment that a file is found and the one that it is opened.
TEST_F(LimitedCache, AFileRemovedBeforeItIsOpenedIsNone) {
  const std::string path = add(1, 5), kept = folder_ / "kept.vdb", next = folder_ / "next.vdb";
  fs::copy_file(path, kept);
  std::atomic<bool> stop = false;
  std::thread other([&] {
    std::error_code failed;
    while (!stop) {
      fs::remove(path, failed);
      fs::copy_file(kept, next, fs::copy_options::overwrite_existing, failed);
      fs::rename(next, path, failed);
    }
  });
  Field field = make_field();
  int found = 0, missing = 0;
  for (int i = 0; i < 100000 && (i < 2000 || found == 0 || missing == 0); ++i) {
    const bool is_found = FieldCache(folder_.path(), warnings_.sink()).load(field, identity_of(1));
    (is_found ? found : missing) += 1;
  }
  stop = true;
  other.join();
  EXPECT_GT(found, 0);
  EXPECT_GT(missing, 0);
  EXPECT_TRUE(warnings_.lines.empty()) << warnings_.lines[0];
}

TEST(FieldCache, AMissingFileIsToldApartFromOneThatCannotBeRead) {
  const TemporaryFolder folder;
  EXPECT_THROW(read_checked(folder / "none.vdb"), MissingFieldFile);
  try {
    read_checked(folder.path());
    FAIL() << "read";
  } catch (const MissingFieldFile&) {
    FAIL() << "missing";
  } catch (const FieldFileError& e) {
    EXPECT_EQ(e.reason(), "is a folder");
  }
}

// ---- little memory

// The file would shrink if one that does not fit into memory counted as one that cannot be used.
TEST(FieldCache, AFileLargerThanMemoryIsLeftAsItIs) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  Warnings warnings;
  FieldCache cache(folder.path(), warnings.sink());
  Field field = make_field(), more = make_field(), loaded = make_field();
  test::fill_random_slices(field, 1, 10);
  test::fill_random_slices(more, 2, 10);
  cache.store(field, identity);
  const std::string path = cache.path_of(identity);
  const uint64_t bytes = fs::file_size(path), too_many = machine_memory_bytes() + 1;
  std::error_code failed;
  fs::resize_file(path, too_many, failed);  // sparse: takes no room on the disk
  if (failed) GTEST_SKIP() << "no file can be that long here: " << failed.message();
  EXPECT_FALSE(cache.load(loaded, identity));
  try {
    cache.store(more, identity);
    FAIL() << "stored";
  } catch (const Error& e) {
    EXPECT_EQ(e.what(), path + ": is larger than memory allows, and is left as it is");
  }
  EXPECT_EQ(fs::file_size(path), too_many);
  fs::resize_file(path, bytes);
  EXPECT_TRUE(FieldCache(folder.path()).load(loaded, identity));
  EXPECT_EQ(differing_slices(loaded, field), 0u);
}

// ---- processes that are killed

TEST(FieldCache, AStoppedWriterHoldsNobodyUpForever) {
  const TemporaryFolder folder;
  const std::string path = folder / "field.vdb.lock";
  const FileLock writer(path);
  EXPECT_THROW(FileLock(path, LockWait::until_free, 0.05), Error);
}

// Whoever interrupts a render does not wait for others' locks.
TEST(FieldCache, AnInterruptedRenderWaitsForNobody) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  std::atomic<bool> stop = true;
  Warnings warnings;
  FieldCache cache(folder.path(), 1, warnings.sink(), &stop);
  Field field = make_field();
  test::fill_random_slices(field, 1, 100);
  {
    const FileLock writer(cache.path_of(identity) + ".lock");
    EXPECT_THROW(cache.store(field, identity), Error);
    const FileLock trimmer(folder / "trim.lock");
    cache.trim();
    ASSERT_EQ(warnings.lines.size(), 1u);
    EXPECT_NE(warnings.lines[0].find("is not kept"), std::string::npos) << warnings.lines[0];
  }
  cache.store(field, identity);  // that are free are taken
  EXPECT_GT(cache.bytes_on_disk(identity), 0u);
}

TEST(FieldCache, AKilledWriterHoldsNobodyUp) {
  const TemporaryFolder folder;
  const FieldIdentity identity = test::test_identity(k_small);
  FieldCache cache(folder.path());
  const std::string path = cache.path_of(identity);
  int ready[2];
  ASSERT_EQ(pipe(ready), 0);
  const pid_t child = fork();
  if (child == 0) {
    const FileLock lock(path + ".lock");
    const AtomicFile half(path);
    if (write(ready[1], "x", 1) != 1) _exit(1);
    pause();
    _exit(0);
  }
  char byte;
  ASSERT_EQ(read(ready[0], &byte, 1), 1);
  EXPECT_FALSE(FileLock(path + ".lock", LockWait::none).held());
  ASSERT_EQ(kill(child, SIGKILL), 0);
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  close(ready[0]);
  close(ready[1]);
  std::ofstream(folder / "other.vdb.1-0.tmp") << "another program's";
  const auto temporaries = [&] {
    size_t n = 0;
    for (const auto& entry : fs::directory_iterator(folder.path())) n += entry.path().extension() == ".tmp";
    return n;
  };
  EXPECT_EQ(temporaries(), 2u);
  Field field = make_field(), loaded = make_field();
  test::fill_random_slices(field, 1, 50);
  cache.store(field, identity);
  EXPECT_TRUE(cache.load(loaded, identity));
  EXPECT_EQ(differing_slices(field, loaded), 0u);
  EXPECT_EQ(temporaries(), 1u);  // those of the killed process are gone
}

TEST(FieldCache, AFolderThatCannotBeWrittenIsAnError) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  EXPECT_THROW(FieldCache(folder / "file"), Error);
  EXPECT_THROW(FieldCache(folder / "file/below"), Error);
  // The folder was removed after the cache was opened.
  const FieldIdentity identity = test::test_identity(k_small);
  FieldCache cache(folder / "gone");
  Field field = make_field();
  test::fill_slice(field, FieldLayer::depth, 1);
  fs::remove_all(folder / "gone");
  EXPECT_THROW(cache.store(field, identity), Error);
}

}  // namespace
}  // namespace fieldtrace
