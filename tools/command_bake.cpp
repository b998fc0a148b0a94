// `fieldtrace bake`: the field of one object, or of a scene's objects, ahead of rendering.
#include "tools/command.h"
#include "tools/options.h"

namespace fieldtrace {

namespace {

struct BakeArguments {
  SceneArguments input;
  std::string output;
  bool full = false;
  RenderOptions options;
};

}  // namespace

void add_bake_command(CommandLine& line) {
  const auto arguments = std::make_shared<BakeArguments>();
  CLI::App& command = *line.app.add_subcommand("bake", "Bake displacement fields ahead of rendering");
  command.add_option("input", arguments->input.path, "Scene or mesh")->required()->type_name("SCENE.xml|MESH");
  command.add_option("-o", arguments->output, "Field to write")->required()->type_name("FIELD.vdb");
  command.add_flag("--full", arguments->full, "Bake every cell, not only those that the scene demands");
  command.add_option("--directions", arguments->options.directions, "Direction cells D")
      ->check(field_directions())
      ->type_name("D");
  command.add_option("--plane", arguments->options.plane, "Plane cells N")->check(field_plane())->type_name("N");
  command.add_option("--chart", "How rays are cut into cells")->type_name("C");
  add_scene_reading_options(command, arguments->input);
  // Fields are baked while rendering, and kept by --field-cache; there is no separate bake to call yet.
  command.callback([arguments, &line] {
    line.action = []() -> int { throw not_available_yet("the bake command (use render --field-cache DIR)"); };
  });
}

}  // namespace fieldtrace
