// Writes the meshes of core/mesh/mesh_stress.h with default parameters as PLY files: stress_meshes FOLDER.
#include <fmt/format.h>

#include <exception>
#include <filesystem>

#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_stress.h"

int main(int argc, char** argv) {
  using namespace fieldtrace;
  if (argc != 2 || argv[1][0] == '-') {
    fmt::print(stderr, "stress_meshes: use: stress_meshes FOLDER\n");
    return 2;
  }
  try {
    const std::filesystem::path folder = argv[1];
    std::filesystem::create_directories(folder);
    const auto write = [&](const char* name, const TriangleMesh& mesh) {
      save_ply((folder / (std::string(name) + ".ply")).string(), mesh);
    };
    write("comb", make_comb());
    write("wire_globe", make_wire_globe());
    write("hair_ball", make_hair_ball());
    write("wavy_sheet", make_wavy_sheet());
    write("holy_sphere", make_holy_sphere());
    write("sliver_fan", make_sliver_fan());
    return 0;
  } catch (const std::exception& e) {
    fmt::print(stderr, "stress_meshes: {}\n", e.what());
    return 1;
  }
}
