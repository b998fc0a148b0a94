// Counts what the kernels do for a look-up on the rays of real pictures, by their PTX behind the emulated device.
//
//   look_up_counts [SCENE.xml [-D name=value]...] [--spp N] [--light-samples M]
//
// Prints JSON: for each scene and kind of question, over all launches, the questions asked (entries), their look-ups,
// the warps' instructions, requests and sectors (tests/gpu/ptx_counts.h), and the bytes over the bus in both
// directions, with what fields' copies and blocks that were left to the CPU take. Of a sky's cells questions are cells
// of points, look-ups the maps that these read. Without a scene: four that need no other files, an object over a floor,
// three objects under three lights, a crowd, a glossy floor under a sky. "cold": blocks of 32 that the device answered
// and left to the CPU while fields were baked, and the rays of these bakes. One thread, so that figures are
// reproducible; fields are baked before. And for each scene the samples of its waves. Exit codes: 0; 1 a scene cannot
// be rendered, or its picture is not the CPU's; 2 wrong use; 77 there are no kernels.
#include <unistd.h>

#include <bit>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/loader/scene_xml.h"
#include "gpu/device_arguments.h"
#include "tests/gpu/picture_checks.h"
#include "tests/gpu/ptx_counts.h"
#include "tests/gpu/ptx_kernels.h"
#include "tests/gpu/recording_device.h"
#include "tests/support/reference_scenes.h"

namespace fieldtrace {
namespace {

using gpu::Kernel;

struct QuestionCounts {
  uint64_t entries = 0, lookups = 0;
  ptx::PtxCounts kernel;
};

// What run_counted() has counted, and rays made for the question that comes next.
QuestionCounts counts[gpu::k_kernels];
ptx::PtxCounts made;

template <class Masks>
uint64_t lookups_of(const Masks* masks, uint32_t warps) {
  uint64_t lookups = 0;
  for (uint32_t w = 0; w < warps; ++w) lookups += masks[w].lookups;
  return lookups;
}

void run_counted(Kernel kernel, uint32_t warps, const void* arguments) {
  QuestionCounts& c = counts[int(kernel)];
  for (const ptx::CountingKernel& k : ptx::counting_kernels()) {
    if (k.name == gpu::k_kernel_names[int(kernel)]) c.kernel += k.launch(warps, arguments);
  }
  if (kernel == Kernel::light_rays) made += std::exchange(c.kernel, {});
  if (kernel == Kernel::filter_strata || kernel == Kernel::query) c.kernel += std::exchange(made, {});
  const uint32_t entries = warps * gpu::k_warp;
  if (kernel == Kernel::light_cones) {
    const auto& a = *static_cast<const gpu::ConeArguments*>(arguments);
    c.lookups += lookups_of(a.masks, warps);
    for (uint32_t w = 0; w < warps; ++w) c.entries += uint64_t(std::popcount(a.wanted[w]));
  } else if (kernel == Kernel::filter_strata) {
    const auto& a = *static_cast<const gpu::StratumArguments*>(arguments);
    c.lookups += lookups_of(a.masks, warps);
    for (uint32_t i = 0; i < entries; ++i) {
      const uint32_t w = i / gpu::k_warp, lane = i % gpu::k_warp;
      c.entries += (a.wanted[w] >> lane & 1u) && a.rays.tmax[a.blocks[w] + lane] >= 0.0f;
    }
  } else if (kernel == Kernel::filter_lobes) {
    const auto& a = *static_cast<const gpu::LobeArguments*>(arguments);
    c.lookups += lookups_of(a.masks, warps);
    for (uint32_t i = 0; i < entries; ++i) {
      c.entries += a.lobes.density[a.blocks[i / gpu::k_warp] + i % gpu::k_warp] > 0.0f;
    }
  } else if (kernel == Kernel::sky_cells) {
    const auto& a = *static_cast<const gpu::SkyArguments*>(arguments);
    for (const gpu::SkyBlock& block : std::span(a.blocks, warps)) {
      c.entries += uint64_t(block.cells) * gpu::k_warp;
      for (const CellTask& task : std::span(a.tasks + block.first_task, block.cells)) {
        c.lookups += uint64_t(task.map_count + (task.own != nullptr)) * gpu::k_warp;
      }
    }
  } else if (kernel == Kernel::query) {
    const auto& a = *static_cast<const gpu::QueryArguments*>(arguments);
    c.lookups += lookups_of(a.masks, warps);
    for (uint32_t i = 0; i < entries; ++i) {
      c.entries += a.rays.tmax[a.blocks[i / gpu::k_warp] + i % gpu::k_warp] >= 0.0f;
    }
  }
}

struct Folder {
  Folder() { std::filesystem::create_directories(path); }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  const std::string path =
      (std::filesystem::temp_directory_path() / ("fieldtrace_look_up_counts_" + std::to_string(getpid()))).string();
};

nlohmann::json count(const Scene& scene, RenderOptions o) {
  for (QuestionCounts& c : counts) c = {};
  o.threads = 1;
  // The fields are baked before; meanwhile the device leaves what it meets first to the CPU.
  const Folder folder;
  o.field_cache = folder.path;
  const Stats cold = test::render_emulated(scene, o).result.stats;
  gpu::EmulatedFaults faults;
  faults.run_kernel = &run_counted;
  const test::EmulatedPicture picture = test::render_emulated(scene, o, faults);
  for (const std::string& warning : picture.warnings) throw Error(warning);
  if (picture.result.image.data != render(scene, o).image.data) throw Error("the picture is not the CPU's");
  nlohmann::json kinds;
  for (const Kernel kernel :
       {Kernel::light_cones, Kernel::filter_strata, Kernel::query, Kernel::filter_lobes, Kernel::sky_cells}) {
    const QuestionCounts& c = counts[int(kernel)];
    kinds[gpu::k_kernel_names[int(kernel)]] = {{"entries", c.entries},
                                               {"lookups", c.lookups},
                                               {"launches", picture.log.launches[int(kernel)]},
                                               {"warps", c.kernel.warps},
                                               {"instructions", c.kernel.instructions},
                                               {"requests", c.kernel.requests},
                                               {"request_sectors", c.kernel.request_sectors},
                                               {"warp_sectors", c.kernel.warp_sectors},
                                               {"bytes_up", picture.log.bytes_up[int(kernel)]},
                                               {"bytes_down", picture.log.bytes_down[int(kernel)]}};
  }
  test::WaveSizes sizes;
  test::render_recorded(scene, o, sizes);
  nlohmann::json waves;
  const char* const levels[test::k_levels] = {"light_cones", "filter_strata", "query", "filter_lobes", "sky_cells"};
  for (int i = 0; i < test::k_levels; ++i) waves[levels[i]] = sizes[i];
  return {{"kinds", kinds},
          {"wave_samples", waves},
          {"bytes_resident", picture.result.stats.device_bytes},
          {"cold", {{"blocks", cold.device_blocks}, {"blocks_cpu", cold.device_blocks_cpu}, {"rays", cold.bake_rays}}},
          {"blocks", picture.result.stats.device_blocks},
          {"blocks_cpu", picture.result.stats.device_blocks_cpu}};
}

int run(const std::string& path, const SceneLoadOptions& loading, int spp, int light_samples) {
  if (ptx::counting_kernels().empty()) {
    std::cout << ptx::k_no_kernels << "\n";
    return 77;
  }
  RenderOptions o;
  o.spp = spp;
  o.light_samples = light_samples;
  o.leave_to_rays = false;  // pictures may be too small to pay for fields
  nlohmann::json code;
  for (const ptx::CountingKernel& k : ptx::counting_kernels()) code[k.name] = k.instructions;
  nlohmann::json scenes;
  if (!path.empty()) {
    scenes[path] = count(load_scene(path, loading), o);
  } else {
    scenes["floor"] = count(test::load_reference_scene(test::reference_scene("floor")), o);
    scenes["three_objects"] = count(test::load_reference_scene(test::reference_scene("area_lights")), o);
    scenes["crowd"] = count(test::crowd(64), o);
    o.lobe_samples = 256;
    o.crop = Rect{32, 48, 48, 48};
    scenes["glossy"] = count(test::glossy_floor(128, true), o);
  }
  std::cout << nlohmann::json{{"target", ptx::counting_kernels()[0].target}, {"code", code}, {"scenes", scenes}}.dump(2)
            << "\n";
  return 0;
}

}  // namespace
}  // namespace fieldtrace

int main(int count, char** arguments) {
  std::string path;
  fieldtrace::SceneLoadOptions loading;
  loading.warning = [](const std::string& text) { std::cerr << "warning: " << text << "\n"; };
  int spp = 1, light_samples = 16;
  const auto usage = [] {
    std::cerr << "usage: look_up_counts [SCENE.xml [-D name=value]...] [--spp N] [--light-samples M]\n";
    return 2;
  };
  for (int i = 1; i < count; ++i) {
    const std::string a = arguments[i];
    const std::string value = i + 1 < count ? arguments[i + 1] : "";
    const size_t equals = value.find('=');
    if (a == "-D" && equals != std::string::npos) {
      loading.parameters[value.substr(0, equals)] = value.substr(equals + 1);
    } else if (a == "--spp" && std::atoi(value.c_str()) > 0) {
      spp = std::atoi(value.c_str());
    } else if (a == "--light-samples" && std::atoi(value.c_str()) > 0) {
      light_samples = std::atoi(value.c_str());
    } else if (!a.empty() && a[0] != '-' && path.empty()) {
      path = a;
      continue;
    } else {
      return usage();
    }
    ++i;
  }
  try {
    return fieldtrace::run(path, loading, spp, light_samples);
  } catch (const std::exception& e) {
    std::cerr << "look_up_counts: " << e.what() << "\n";
    return 1;
  }
}
