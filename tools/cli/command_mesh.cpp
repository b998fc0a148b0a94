// `fieldtrace mesh`: procedural meshes as PLY files. The generators check their parameters' ranges.
#include <fmt/format.h>

#include <atomic>
#include <filesystem>
#include <limits>
#include <type_traits>

#include "core/io/atomic_file.h"
#include "core/mesh/mesh_io.h"
#include "core/mesh/mesh_procedural.h"
#include "core/mesh/mesh_stress.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/options.h"
#include "tools/cli/standard_output.h"

namespace fieldtrace {

namespace {

// One parameter of a generator: its option, target and description. The default shown is that of the struct.
template <class T>
void parameter(CLI::App& command, const std::string& name, T& target, const std::string& help) {
  CLI::Option* const option =
      command.add_option("--" + name, target, fmt::format("{} (default: {})", help, target))->type_name("X");
  if constexpr (std::is_integral_v<T>) {
    using Limits = std::numeric_limits<T>;
    option->transform(whole_number_between(Limits::min(), Limits::max()).description(""));
  }
}

void superformula(CLI::App& command, const std::string& suffix, Superformula& f, const std::string& which) {
  parameter(command, "m" + suffix, f.m, which + ": symmetry, 0 to 1000");
  parameter(command, "n1" + suffix, f.n1, which + ": exponent n1, 0.01 to 1000");
  parameter(command, "n2" + suffix, f.n2, which + ": exponent n2, 0 to 1000");
  parameter(command, "n3" + suffix, f.n3, which + ": exponent n3, 0 to 1000");
  parameter(command, "a" + suffix, f.a, which + ": scale a, 0.001 to 1000");
  parameter(command, "b" + suffix, f.b, which + ": scale b, 0.001 to 1000");
}

void add_parameters(CLI::App& command, SupershapeParams& p) {
  superformula(command, "", p.longitude, "Longitude");
  superformula(command, "-lat", p.latitude, "Latitude");
  parameter(command, "around", p.around, "Cells around the axis, 3 to 32768");
  parameter(command, "along", p.along, "Cells from pole to pole, 2 to 32768");
  parameter(command, "radius", p.radius, "Distance of the farthest vertex, 1e-6 to 1e6");
}

void add_parameters(CLI::App& command, HyperboloidParams& p) {
  parameter(command, "waist", p.waist, "Radius in the middle, 1e-6 to 1e6");
  parameter(command, "rim", p.rim, "Radius at both ends, above the waist, up to 1e6");
  parameter(command, "half-height", p.half_height, "Half the height, 1e-6 to 1e6");
  parameter(command, "around", p.around, "Cells around the axis, 3 to 32768");
  parameter(command, "along", p.along, "Cells along the axis, 1 to 32768");
}

void add_parameters(CLI::App& command, KnotParams& p) {
  parameter(command, "p", p.p, "Turns about the axis, 1 to 64");
  parameter(command, "q", p.q, "Turns about the core of the torus, 0 to 64");
  parameter(command, "major", p.major, "Radius of the torus' core circle, 1e-6 to 1e6");
  parameter(command, "minor", p.minor, "Radius of the torus, above 0, below the major one");
  parameter(command, "tube", p.tube, "Radius of the tube, less than the curve's least radius of curvature");
  parameter(command, "along", p.along, "Cells along the curve, 8 to 4194304");
  parameter(command, "around", p.around, "Cells around the tube, 3 to 32768");
}

void add_parameters(CLI::App& command, SphereParams& p) {
  parameter(command, "radius", p.radius, "Radius, 1e-6 to 1e6");
  parameter(command, "around", p.around, "Cells around the axis, 3 to 32768");
  parameter(command, "along", p.along, "Cells from pole to pole, 2 to 32768");
}

void add_parameters(CLI::App& command, PlaneParams& p) {
  parameter(command, "half-size", p.half_size, "Half an edge, 1e-6 to 1e6");
  parameter(command, "columns", p.columns, "Cells along x, 1 to 32768");
  parameter(command, "rows", p.rows, "Cells along y, 1 to 32768");
}

void add_parameters(CLI::App& command, CubeParams& p) {
  parameter(command, "half-size", p.half_size, "Half an edge, 1e-6 to 1e6");
  parameter(command, "divisions", p.divisions, "Cells along an edge, 1 to 2048");
}

void add_parameters(CLI::App& command, CombParams& p) {
  parameter(command, "slats", p.slats, "Slats, 1 to 100000");
  parameter(command, "solid-share", p.solid_share, "Thickness of a slat / their distance, 0.0001 to below 1");
}

void add_parameters(CLI::App& command, WireGlobeParams& p) {
  parameter(command, "meridians", p.meridians, "Great circles through the poles, 0 to 1000");
  parameter(command, "parallels", p.parallels, "Circles of latitude, 0 to 1000");
  parameter(command, "wire-radius", p.wire_radius, "Radius of a wire / of the globe, 1e-5 to 0.1");
  parameter(command, "along", p.along, "Cells along a wire, 8 to 32768");
  parameter(command, "around", p.around, "Cells around a wire, 3 to 256");
}

void add_parameters(CLI::App& command, HairBallParams& p) {
  parameter(command, "hairs", p.hairs, "Hairs, 1 to 1000000");
  parameter(command, "segments", p.segments, "Segments of a hair, 1 to 64");
  parameter(command, "hair-radius", p.hair_radius, "Radius of a hair at its root, 1e-5 to 0.05");
  parameter(command, "ball-radius", p.ball_radius, "Distance of the roots from the centre, 0.05 to 0.9");
  parameter(command, "bend", p.bend, "Sideways drift of the tip / length, 0 to 1");
  parameter(command, "seed", p.seed, "Seed of the hairs' directions");
}

void add_parameters(CLI::App& command, WavySheetParams& p) {
  parameter(command, "half-size", p.half_size, "Half an edge, 0.01 to 0.7");
  parameter(command, "amplitude", p.amplitude, "Height of the waves, 0 to 0.15");
  parameter(command, "waves", p.waves, "Waves along an edge, 0 to 1000");
  parameter(command, "cells", p.cells, "Cells along an edge, 1 to 4096");
}

void add_parameters(CLI::App& command, HolySphereParams& p) {
  parameter(command, "holes", p.holes, "Holes, 0 to 1000");
  parameter(command, "hole-radius", p.hole_radius_degrees, "Radius of a hole in degrees, 0 to 60");
  parameter(command, "around", p.around, "Cells around the axis, 3 to 32768");
  parameter(command, "along", p.along, "Cells from pole to pole, 2 to 32768");
}

void add_parameters(CLI::App& command, SliverFanParams& p) {
  parameter(command, "slivers", p.slivers, "Slivers, 1 to 1000000");
  parameter(command, "aspect", p.aspect, "Width / length of a sliver, 1e-7 to 0.1");
}

int write_mesh(const std::string& path, const TriangleMesh& mesh, const std::atomic<bool>& stop) {
  if (stop) return report_interrupted(path);
  save_ply(path, mesh);
  print_message("{}: {} triangles, {} vertices\n", path, mesh.triangles.size(), mesh.positions.size());
  return k_exit_success;
}

void require_ply(const std::string& path) {
  if (std::filesystem::path(path).extension() != ".ply") throw UsageError("-o " + path + ": end the name in .ply");
  require_writable(path);
}

template <class Params>
void add_generator(CLI::App& mesh, CommandLine& line, const char* name, const char* help,
                   TriangleMesh (*make)(const Params&)) {
  struct Arguments {
    Params params;
    std::string output;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *mesh.add_subcommand(name, help);
  command.add_option("-o", arguments->output, "Mesh to write")->required()->type_name("FILE.ply");
  add_parameters(command, arguments->params);
  command.callback([arguments, make, &line] {
    line.action = [arguments, make] {
      require_ply(arguments->output);
      const std::atomic<bool>& stop = stop_on_interrupt();
      return write_mesh(arguments->output, make(arguments->params), stop);
    };
  });
}

}  // namespace

void add_mesh_command(CommandLine& line) {
  CLI::App& mesh = *line.app.add_subcommand("mesh", "Write a procedural mesh");
  mesh.require_subcommand(1);
  add_generator(mesh, line, "supershape", "Spherical product of two superformulas", make_supershape);
  add_generator(mesh, line, "hyperboloid", "Hyperboloid of one sheet", make_hyperboloid);
  add_generator(mesh, line, "knot", "Torus knot", make_knot);
  add_generator(mesh, line, "sphere", "Sphere of latitudes and longitudes", make_sphere);
  add_generator(mesh, line, "plane", "Square grid", make_plane);
  add_generator(mesh, line, "cube", "Cube", make_cube);
  add_generator(mesh, line, "comb", "Parallel thin slats", make_comb);
  add_generator(mesh, line, "globe", "Globe of wires", make_wire_globe);
  add_generator(mesh, line, "hairs", "Hairs that grow out of a ball", make_hair_ball);
  add_generator(mesh, line, "sheet", "Open wavy sheet", make_wavy_sheet);
  add_generator(mesh, line, "holes", "Sphere with round holes", make_holy_sphere);
  add_generator(mesh, line, "fan", "Fan of slivers", make_sliver_fan);
}

}  // namespace fieldtrace
