// Files that are replaced as a whole, behind symbolic links too, and temporary folders.
#include "core/io/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "core/io/scratch_folder.h"
#include "core/platform/error.h"

namespace {
std::vector<ino_t> synced;  // what this process has flushed to disk, in order
}

// Stands in for the system's in this program.
extern "C" int fsync(int file) {
  struct stat held;
  if (fstat(file, &held) == 0) synced.push_back(held.st_ino);
  return int(syscall(SYS_fsync, file));
}

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

std::string read_text(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

class AtomicFiles : public testing::Test {
 protected:
  fs::path at(const std::string& name) const { return fs::path(folder_.path()) / name; }
  std::string write_and_read(const std::string& name, const std::string& text) const {
    write_text_file(at(name), text);
    return read_text(at(name));
  }
  size_t files() const { return size_t(std::distance(fs::directory_iterator(folder_.path()), {})); }

  const ScratchFolder folder_{fs::temp_directory_path().string(), "fieldtrace_atomic_file"};
};

TEST_F(AtomicFiles, LinksStayWhetherTheirTargetsExistOrNot) {
  fs::create_directory(at("away"));
  fs::create_symlink("away/file", at("relative"));
  fs::create_symlink(at("away/other"), at("absolute"));
  fs::create_symlink("relative", at("twice"));
  fs::create_directory_symlink("away", at("folder"));
  fs::create_symlink("../third", at("away/up"));
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"twice", "away/file"}, {"relative", "away/file"}, {"absolute", "away/other"}, {"folder/up", "third"}};
  for (const auto& [link, target] : cases) {
    for (const char* text : {"new", "replaced"}) {
      EXPECT_EQ(write_and_read(link, text), text);
      EXPECT_TRUE(fs::is_symlink(at(link))) << link;
      EXPECT_TRUE(fs::is_regular_file(fs::symlink_status(at(target)))) << target;
      EXPECT_EQ(read_text(at(target)), text);
      EXPECT_EQ(write_target(at(link)), fs::canonical(at(target)));
    }
  }
  EXPECT_EQ(files(), 6u);
}

TEST_F(AtomicFiles, LinksThatEndNowhereAreErrors) {
  fs::create_symlink("loop", at("loop"));
  fs::create_symlink("no/file", at("missing"));
  for (const char* name : {"loop", "missing"}) {
    EXPECT_THROW(write_text_file(at(name), "text"), Error) << name;
    EXPECT_TRUE(fs::is_symlink(at(name))) << name;
  }
  EXPECT_THROW(write_target(at("loop")), Error);
  // The system follows 40 links; so does write_target().
  fs::create_symlink("end", at("1"));
  for (int i = 2; i <= 41; ++i) fs::create_symlink(std::to_string(i - 1), at(std::to_string(i)));
  EXPECT_EQ(write_and_read("40", "text"), "text");
  EXPECT_EQ(read_text(at("end")), "text");
  EXPECT_THROW(write_target(at("41")), Error);
}

TEST_F(AtomicFiles, TheFolderIsFlushedAfterTheFile) {
  fs::create_directory(at("away"));
  fs::create_symlink("away/file", at("link"));
  struct stat folder, file;
  for (const char* text : {"new", "replaced"}) {
    synced.clear();
    write_text_file(at("link"), text);
    ASSERT_EQ(stat(at("away").c_str(), &folder), 0);
    ASSERT_EQ(stat(at("away/file").c_str(), &file), 0);
    EXPECT_EQ(synced, (std::vector<ino_t>{file.st_ino, folder.st_ino}));
  }
}

TEST_F(AtomicFiles, ReplacedFilesKeepTheirPermissionsAndReadOnlyOnesStay) {
  const std::string path = at("file").string();
  write_text_file(path, "old");
  ASSERT_EQ(chmod(path.c_str(), 0640), 0);
  write_text_file(path, "new");
  struct stat held;
  ASSERT_EQ(stat(path.c_str(), &held), 0);
  EXPECT_EQ(held.st_mode & 07777, 0640u);
  ASSERT_EQ(chmod(path.c_str(), 0440), 0);
  if (access(path.c_str(), W_OK) == 0) GTEST_SKIP() << "this user may write to everything";
  EXPECT_THROW(require_writable(path), Error);
  EXPECT_EQ(read_text(path), "new");
}

// A whole file that cannot be moved is not lost, and one alone is kept.
TEST_F(AtomicFiles, WhatCannotBeMovedIsKept) {
  const std::string path = at("file").string();
  for (const char* text : {"one", "another"}) {
    AtomicFile file(path);
    std::ofstream(file.temporary_path()) << text;
    fs::create_directories(at("file") / "in the way");
    try {
      file.commit();
      FAIL();
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(path + ".whole"), std::string::npos) << e.what();
    }
    EXPECT_EQ(read_text(path + ".whole"), text);
    fs::remove_all(at("file"));
  }
  EXPECT_EQ(files(), 1u);
}

// As a container sees a file of its host.
TEST_F(AtomicFiles, AMountIsWrittenInPlace) {
  write_and_read("host", "a longer text of before");
  const std::string path = at("file").string();
  std::ofstream(path) << "";
  if (mount(at("host").c_str(), path.c_str(), nullptr, MS_BIND, nullptr) != 0)
    GTEST_SKIP() << "this user may not mount";
  EXPECT_EQ(write_and_read("file", "text"), "text");
  umount(path.c_str());
  EXPECT_EQ(read_text(at("host")), "text");
  EXPECT_EQ(files(), 2u);
}

// What a killed process or one of another machine, with the same number, has left or is writing.
TEST_F(AtomicFiles, TemporaryNamesThatAreTakenAreLeftAlone) {
  for (int i = 0; i < 100; ++i)
    std::ofstream(at("file." + std::to_string(getpid()) + "-" + std::to_string(i) + ".tmp")) << "other";
  EXPECT_EQ(write_and_read("file", "text"), "text");
  EXPECT_EQ(files(), 101u);
  for (const auto& entry : fs::directory_iterator(folder_.path()))
    EXPECT_EQ(read_text(entry.path()), entry.path().filename() == "file" ? "text" : "other");
}

TEST_F(AtomicFiles, ScratchFoldersAreDistinctAndGoWithTheirContents) {
  {
    const ScratchFolder first(folder_.path(), "name"), second(folder_.path(), "name");
    EXPECT_NE(first.path(), second.path());
    for (const ScratchFolder* f : {&first, &second}) {
      EXPECT_TRUE(fs::is_directory(f->path()));
      EXPECT_EQ(fs::path(f->path()).filename().string().rfind("name-", 0), 0u) << f->path();
      EXPECT_EQ(fs::path(f->path()).extension(), ".tmp");
      fs::create_directory(f->path() + "/inner");
      write_text_file(f->path() + "/inner/file", "text");
    }
    // A file that bears the next name is left alone.
    std::string taken = second.path();
    taken.replace(taken.rfind("-1."), 3, "-2.");
    write_text_file(taken, "not ours");
    EXPECT_NE(ScratchFolder(folder_.path(), "name").path(), taken);
    EXPECT_EQ(read_text(taken), "not ours");
  }
  EXPECT_EQ(files(), 1u);
  EXPECT_THROW(ScratchFolder(at("missing").string(), "name"), Error);
}

}  // namespace
}  // namespace fieldtrace
