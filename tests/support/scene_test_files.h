// Helpers of the scene tests: a separate folder for each test, and loading of scenes given as text.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "core/loader/scene_xml.h"

namespace fieldtrace {

class SceneFiles : public testing::Test {
 protected:
  void SetUp() override {
    const testing::TestInfo* info = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = info->name();
    std::replace(name.begin(), name.end(), '/', '_');  // parameterised tests
    folder_ = std::filesystem::temp_directory_path() / ("fieldtrace_" + name + "_" + std::to_string(getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  std::string write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    // Truncating a file in place makes some file systems wait for the disk; creating one does not.
    std::filesystem::remove(path(name));
    std::ofstream(path(name), std::ios::binary) << text;
    return path(name);
  }

  // Loads `body` inside a <scene>; its first line is line 2 of scene.xml.
  Scene load(const std::string& body) {
    return load_file(write("scene.xml", "<scene version=\"3.0.0\">\n" + body + "\n</scene>\n"));
  }

  Scene load_file(const std::string& file) {
    warnings.clear();
    SceneLoadOptions options;
    options.parameters = parameters;
    options.strict = strict;
    options.warning = [this](const std::string& text) { warnings.push_back(text); };
    return load_scene(file, options);
  }

  // The message of the Error that loading `body` throws; empty if it loads.
  std::string error_of(const std::string& body) {
    try {
      load(body);
    } catch (const Error& error) {
      return error.what();
    }
    return {};
  }

  // Whether some warning contains `text`.
  bool warned(const std::string& text) const {
    for (const std::string& warning : warnings)
      if (warning.find(text) != std::string::npos) return true;
    return false;
  }

  std::map<std::string, std::string> parameters;
  bool strict = false;
  std::vector<std::string> warnings;

 private:
  std::filesystem::path folder_;
};

// A sensor, to avoid the warning that there is none.
inline const std::string k_sensor = "<sensor type=\"perspective\"/>";

}  // namespace fieldtrace
