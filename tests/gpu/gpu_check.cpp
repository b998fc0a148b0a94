// Checks a GPU and times its look-ups; called by tools/gpu_check.sh.
//
//   gpu_check [--emulated] [--quick] [--json FILE]
//
// Random and extreme questions go to the device until it answers all of them itself; its answers must be the CPU's, bit
// for bit. Then single rays are timed: kernels alone on resident fields of three sizes, with the share of the memory's
// bandwidth that they reach if no two warps share a sector, and whole questions with their copies. --emulated: a device
// in host memory, whose times mean nothing. --quick: fewer questions, one small field. Exit codes: 0 all answers are
// equal; 1 they are not, or the device fails; 2 wrong use; 77 there is no device.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/platform/stopwatch.h"
#include "core/simd/isa.h"
#include "field/maps/cell_tasks.h"
#include "gpu/device.h"
#include "gpu/emulated.h"
#include "gpu/runtime_cuda.h"
#include "tests/gpu/ask_device.h"
#include "tests/gpu/ptx_counts.h"
#include "tests/support/cell_tasks.h"

extern "C" const std::byte fieldtrace_kernels[];
extern "C" const uint64_t fieldtrace_kernels_bytes;

namespace fieldtrace::gpu {
namespace {

struct Options {
  bool emulated = false, quick = false;
  std::string json;
};

std::unique_ptr<Runtime> open_runtime(const Options& options) {
  if (!options.emulated) return open_cuda_runtime();
  return std::make_unique<EmulatedRuntime>(EmulatedFaults{}, std::make_shared<EmulatedLog>());
}

std::span<const std::byte> kernels() { return {fieldtrace_kernels, size_t(fieldtrace_kernels_bytes)}; }

// ---- equal answers

template <class T>
bool same(const AlignedVector<T>& a, const AlignedVector<T>& b) {
  for (size_t i = 0; i < a.size(); ++i) {
    const bool both_nan = std::isnan(double(a[i])) && std::isnan(double(b[i]));
    if (a[i] != b[i] && !both_nan) return false;
  }
  return a.size() == b.size();
}

// Asks until the device leaves nothing to the CPU, but no more often than a mirror can grow; compares every time.
// ask(answerer) returns the answers.
template <class Ask>
bool check_question(const Answerer& by, const Ask& ask) {
  const auto expected = ask(Answerer{by.kernels});
  for (int round = 0; round < 64; ++round) {
    const uint64_t before = by.device->counts().blocks_cpu;
    if (!ask(by).equals(expected)) return false;
    if (by.device->counts().blocks_cpu == before) return true;
  }
  return false;
}

struct RayAnswers {
  AlignedVector<int32_t> state, verdict;
  SegmentCounts counts;
  bool equals(const RayAnswers& o) const {
    return same(state, o.state) && same(verdict, o.verdict) && counts.lookups == o.counts.lookups &&
           counts.crossings == o.counts.crossings;
  }
};
struct StratumAnswers {
  AlignedVector<float> clear;
  AlignedVector<int32_t> refused;
  uint64_t lookups;
  bool equals(const StratumAnswers& o) const {
    return same(clear, o.clear) && same(refused, o.refused) && lookups == o.lookups;
  }
};
struct LightAnswers {
  AlignedVector<int32_t> flags;
  ConeCounts counts;
  bool equals(const LightAnswers& o) const {
    return same(flags, o.flags) && counts.clear == o.counts.clear && counts.blocked == o.counts.blocked &&
           counts.lookups == o.counts.lookups;
  }
};

struct LobesAnswers {
  LobeAnswers of;
  uint64_t lookups;
  bool equals(const LobesAnswers& o) const {
    return same(of.clear, o.of.clear) && same(of.red, o.of.red) && same(of.green, o.of.green) &&
           same(of.blue, o.of.blue) && same(of.distance, o.of.distance) && same(of.refused, o.of.refused) &&
           lookups == o.lookups;
  }
};

bool answers_as_cpu(VisibilityDevice& device, SkyQuestion& question) {
  DeviceWave wave;
  wave.skies.push_back(&question);
  device.answer(wave);
  const auto size = size_t(question.points.size), blocks = size / k_warp, cells = question.tasks->tasks().size();
  AlignedVector<float> sums(6 * size, 0.0f);
  std::vector<uint32_t> undecided(blocks * cells, 0);
  const auto sum = [&](size_t i) { return sums.data() + i * size; };
  AlignedVector<int32_t> listed(size + k_warp);
  for (size_t k = 0; k < cells; ++k) {
    const int count = cell_kernels(Isa::scalar)
                          .see_cell(question.tasks->tasks()[k], question.points,
                                    {sum(0), sum(1), sum(2), sum(3), sum(4), sum(5)}, listed.data());
    for (int l = 0; l < count; ++l) {
      const auto i = size_t(listed[size_t(l)]);
      undecided[i / k_warp * cells + k] |= 1u << (i % k_warp);
    }
  }
  return question.is_answered && question.undecided == undecided &&
         same({question.sums.begin(), question.sums.end()}, sums);
}

// The number of questions of each kind about fields and radiance maps that are answered wrongly, or never.
size_t check_answers(const Answerer& by, size_t entries) {
  TestRandom random(1);
  const RandomField field({32, 64}, 1.0f, random);
  const RandomMaps maps(16, 32, 1.0f, random);
  Values values(2);
  size_t wrong = 0;
  for (size_t done = 0; done < entries;) {
    const Launch l = random_launch(field, values);
    done += l.entries;
    const QueryInputs rays(l, values);
    const ShadowBatch batch = batch_of(rays.rays, rays.instances);
    wrong += !check_question(by, [&](const Answerer& a) {
      RayStates states;
      states.keep_verdicts = true;
      states.reset(l.entries);
      const SegmentCounts counts = ask_rays(a, field.field(), l.task, batch, states);
      return RayAnswers{states.state, states.verdict, counts};
    });
    const StratumInputs strata(l, values);
    wrong += !check_question(by, [&](const Answerer& of) {
      StratumAnswers a = {AlignedVector<float>(padded(l.entries), 1.0f), AlignedVector<int32_t>(padded(l.entries)), 0};
      ConeUnknowns unknowns;
      a.lookups = ask_strata(of, field.field(), strata, a.clear.data(), a.refused.data(), unknowns);
      return a;
    });
    const ConeInputs cones(l, values);
    wrong += !check_question(by, [&](const Answerer& of) {
      LightAnswers a = {cones.flags, {}};
      ConeUnknowns unknowns;
      a.counts = ask_cones(of, field.field(), cones, a.flags.data(), unknowns);
      return a;
    });
    const LobeInputs lobes(random_launch(maps.view(), values), values);
    wrong += !check_question(by, [&](const Answerer& of) {
      LobesAnswers a;
      a.of.resize(lobes.lobes.rays.size);
      ConeUnknowns unknowns;
      a.lookups = ask_lobes(of, maps.tiles(), lobes, a.of, unknowns);
      return a;
    });
  }
  by.device->forget_fields();
  return wrong;
}

// The same for direction cells of skies, by the scalar kernel: what max() makes of NaN depends on the CPU's instruction
// set, and a GPU's does as that one.
size_t check_cells(VisibilityDevice& device, size_t entries) {
  Values values(3);
  TestRandom& random = values.random;
  const test::NoisyMaps maps({8, 16, 64}, {2, 8, 16}, random);
  size_t wrong = 0;
  for (size_t done = 0; done < entries;) {
    std::vector<std::unique_ptr<test::RandomTask>> made;
    CellTasks tasks;
    for (uint32_t n = 1 + random.index(40); n > 0; --n) {
      made.push_back(std::make_unique<test::RandomTask>());
      test::make_task(maps.views, random, *made.back());
      if (random.index(2)) test::add_radiance(maps.radiance, random, *made.back());
      tasks.add(made.back()->task);
    }
    tasks.link();
    test::Points points = test::random_points(*made[0], 1 + random.index(256), random);
    values.wild = random.index(4) == 0 ? 0.05f : 0.0f;
    for (auto& array : points.values) {
      for (float& v : array) v = values.spoilt(v);
    }
    SkyQuestion question = {&tasks, points.view()};
    question.points.grazing = random.index(2) ? random.uniform() : 0.0f;
    wrong += !answers_as_cpu(device, question);
    done += size_t(points.size) * tasks.tasks().size();
  }
  device.forget_fields();
  return wrong;
}

// ---- times

// Rays through the unit ball: of a parallel beam in the order of a grid, or anywhere.
RayBatch beam(size_t rays, bool coherent, TestRandom& random) {
  RayBatch batch;
  batch.resize(rays);
  const int side = std::max(int(std::sqrt(double(rays))), 1);
  for (size_t i = 0; i < rays; ++i) {
    const float x = 1.4f * (float(int(i) % side) / float(side) - 0.5f);
    const float y = 1.4f * (float(int(i) / side) / float(side) - 0.5f);
    const Vec3 from = 3.0f * random.direction(), to = 0.9f * random.in_ball();
    const Vec3 o = coherent ? Vec3(x, y, -3.0f) : from, d = coherent ? Vec3(0.05f, 0.02f, 6.0f) : 2.0f * (to - from);
    batch.set(i, o, d, 1.0f);
  }
  return batch;
}

// Bytes a second that the device copies within its memory, reads and writes counted: the best of 5.
double time_copies(Runtime& runtime, size_t bytes) {
  constexpr Stream k_stream = 0;
  DeviceMemory memory(runtime, ~uint64_t(0));
  DeviceBuffer from(memory, bytes), to(memory, bytes);
  check(runtime, runtime.fill_zero(k_stream, from.address(), bytes), "clearing device memory");
  double best = 0.0;
  for (int round = 0; round < 6; ++round) {
    check(runtime, runtime.synchronise(k_stream), "waiting for the GPU");
    const auto start = std::chrono::steady_clock::now();
    check(runtime, runtime.copy_on_device(k_stream, to.address(), from.address(), bytes), "copying on the device");
    check(runtime, runtime.synchronise(k_stream), "waiting for the GPU");
    if (round > 0) best = std::max(best, 2.0 * double(bytes) / seconds_since(start));  // the first one warms up
  }
  return best;
}

// Bytes of memory that warps read and write for a look-up, a sector once for each warp: counted while the kernel's PTX
// runs on the CPU, for the first of `rays`; 0 where there is none.
double bytes_per_look_up(const Field& field, const SegmentTask& task, const RayBatch& rays) {
  constexpr size_t k_counted = 1 << 14;
  for (const ptx::CountingKernel& kernel : ptx::counting_kernels()) {
    if (kernel.name != k_kernel_names[int(Kernel::query)]) continue;
    const size_t count = std::min(rays.size, k_counted);
    const std::vector<uint32_t> instances(padded(count), task.instance + 1), blocks = blocks_of(count);
    std::vector<RayMasks> masks(blocks.size());
    std::vector<uint32_t> missing(blocks.size() * k_missing_words);
    QueryArguments a = {task,
                        {rays.ox.data(), rays.oy.data(), rays.oz.data(), rays.dx.data(), rays.dy.data(), rays.dz.data(),
                         rays.tmax.data()},
                        instances.data(),
                        blocks.data(),
                        masks.data(),
                        missing.data(),
                        uint32_t(blocks.size())};
    a.task.field = field.view();
    const ptx::PtxCounts counts = kernel.launch(a.warps, &a);
    uint64_t lookups = 0;
    for (const RayMasks& m : masks) lookups += m.lookups;
    return double(counts.warp_sectors * ptx::k_sector_bytes) / double(std::max<uint64_t>(lookups, 1));
  }
  return 0.0;
}

struct Timing {
  double kernel = 0.0;  // look-ups a second
  double least = 0.0, most = 0.0;
  uint64_t lookups = 0;
};

// Kernels alone, on a field that is wholly resident: the median of 9 rounds.
Timing time_kernel(Runtime& runtime, const Field& field, const SegmentTask& task, const RayBatch& rays) {
  constexpr Stream k_stream = 0;
  DeviceMemory memory(runtime, ~uint64_t(0));
  FieldMirror mirror(field, memory);
  StagingBuffer in(memory), out(memory);
  const uint32_t warps = uint32_t(padded(rays.size) / k_warp);
  const auto wait = [&] { check(runtime, runtime.synchronise(k_stream), "waiting for the GPU"); };
  // In parts, so that packets stay small.
  constexpr uint32_t k_part = 1 << 16;
  for (uint32_t first = 0; first < field.slice_count(); first += k_part) {
    std::vector<uint32_t> words;
    for (uint32_t s = first; s < std::min(first + k_part, field.slice_count()); ++s) {
      words.push_back(missing_word(MissingKind::visibility, s));
      words.push_back(missing_word(MissingKind::depth, s));
    }
    mirror.want(words);
    Packet packet;
    mirror.stage(packet, k_stream);
    if (packet.runs.empty()) continue;
    in.clear();
    const size_t runs = in.append(packet.runs.data(), packet.runs.size() * sizeof(ScatterRun));
    const size_t data = in.append(packet.words.data(), packet.words.size() * sizeof(uint32_t));
    wait();  // copies of pools that grew
    packet.outgrown.clear();
    in.ensure_device();
    in.copy_to_device(k_stream);
    const ScatterArguments a = {in.device<const ScatterRun>(runs), in.device<const uint32_t>(data),
                                uint32_t(packet.runs.size())};
    check(runtime, runtime.launch(k_stream, Kernel::scatter, a.warps, &a, sizeof a), "starting the kernel scatter");
    wait();
  }
  in.clear();
  const AlignedVector<float>* const arrays[] = {&rays.ox, &rays.oy, &rays.oz, &rays.dx, &rays.dy, &rays.dz, &rays.tmax};
  size_t at[7];
  for (int i = 0; i < 7; ++i) at[i] = in.append(arrays[i]->data(), arrays[i]->size() * sizeof(float));
  const std::vector<uint32_t> instances(padded(rays.size), task.instance + 1);
  const size_t instances_at = in.append(instances.data(), instances.size() * sizeof(uint32_t));
  const std::vector<uint32_t> blocks = blocks_of(rays.size);
  const size_t blocks_at = in.append(blocks.data(), blocks.size() * sizeof(uint32_t));
  const size_t masks_at = out.reserve(warps * sizeof(RayMasks));
  DeviceBuffer missing(memory, size_t(warps) * k_missing_words * sizeof(uint32_t));
  for (StagingBuffer* b : {&in, &out}) b->ensure_device();
  in.copy_to_device(k_stream);
  const auto array = [&](int i) { return in.device<const float>(at[i]); };
  QueryArguments a = {task,
                      {array(0), array(1), array(2), array(3), array(4), array(5), array(6)},
                      in.device<const uint32_t>(instances_at),
                      in.device<const uint32_t>(blocks_at),
                      out.device<RayMasks>(masks_at),
                      missing.as<uint32_t>(),
                      warps};
  a.task.field = mirror.view();
  std::vector<double> seconds;
  constexpr int k_launches = 10, k_rounds = 9;
  for (int round = 0; round < k_rounds + 1; ++round) {
    wait();
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < k_launches; ++i) {
      check(runtime, runtime.launch(k_stream, Kernel::query, warps, &a, sizeof a), "starting the kernel query");
    }
    wait();
    if (round > 0) seconds.push_back(seconds_since(start) / k_launches);  // the first one warms up
  }
  out.copy_to_host(k_stream);
  wait();
  Timing t;
  for (uint32_t w = 0; w < warps; ++w) t.lookups += out.host<RayMasks>(masks_at)[w].lookups;
  std::sort(seconds.begin(), seconds.end());
  t.kernel = double(t.lookups) / seconds[k_rounds / 2];
  t.least = double(t.lookups) / seconds.back();
  t.most = double(t.lookups) / seconds.front();
  return t;
}

// Look-ups a second of whole questions, copies of rays and answers included; the best of 5.
double time_question(const Answerer& by, const Field& field, const SegmentTask& task, const RayBatch& rays) {
  const ShadowBatch batch = batch_of(rays, AlignedVector<uint32_t>(padded(rays.size), task.instance + 1));
  double best = 0.0;
  for (int round = 0; round < 8; ++round) {  // the first ones copy the field
    RayStates states;
    states.reset(rays.size);
    const auto start = std::chrono::steady_clock::now();
    const SegmentCounts counts = ask_rays(by, field, task, batch, states);
    if (round >= 3) best = std::max(best, double(counts.lookups) / seconds_since(start));
  }
  return best;
}

nlohmann::json time_look_ups(Runtime& runtime, const Answerer& by, bool quick) {
  nlohmann::json rows = nlohmann::json::array();
  const FieldParameters sizes[] = {{32, 64}, {64, 64}, {64, 128}};
  TestRandom random(5);
  const double copied = time_copies(runtime, quick ? size_t(1) << 20 : size_t(1) << 30);
  for (const FieldParameters& p : sizes) {
    if (quick && p.directions > 32) break;
    const RandomField random_field(p, 1.0f, random, false);
    const Field& field = random_field.field();
    SegmentTask task;
    task.field = field.view();
    task.policy = {63, 63, false, 1.0f};
    for (int i = 0; i < 12; ++i) task.to_unit[i] = i % 4 == 0 && i < 9 ? 1.0f : 0.0f;
    for (const bool coherent : {true, false}) {
      const RayBatch rays = beam(quick ? 1 << 14 : 1 << 22, coherent, random);
      const Timing t = time_kernel(runtime, field, task, rays);
      const double bytes = bytes_per_look_up(field, task, rays);
      rows.push_back({{"directions", p.directions},
                      {"plane", p.plane},
                      {"field_bytes", uint64_t(field.slice_count()) * 9 * uint64_t(scalar::k_slice_cells)},
                      {"rays", coherent ? "coherent" : "random"},
                      {"ray_count", rays.size},
                      {"lookups", t.lookups},
                      {"kernel_lookups_per_second", t.kernel},
                      {"kernel_slowest", t.least},
                      {"kernel_fastest", t.most},
                      {"bytes_per_lookup", bytes},
                      {"copied_bytes_per_second", copied},
                      {"share_of_bandwidth", t.kernel * bytes / copied},
                      {"question_lookups_per_second", time_question(by, field, task, rays)},
                      {"cpu_one_thread_lookups_per_second", time_question({by.kernels}, field, task, rays)}});
      by.device->forget_fields();
    }
  }
  return rows;
}

int run(const Options& options) {
  const std::unique_ptr<Runtime> runtime = open_runtime(options);
  const std::vector<std::string> devices = list_devices(*runtime);
  for (const std::string& line : devices) std::cout << line << "\n";
  if (devices[0].rfind("none", 0) == 0) return 77;
  const SegmentKernels& table = segment_kernels(resolve_isa(Isa::automatic));
  GpuDevice device(open_runtime(options), kernels(),
                   {0, [](const std::string& text) { std::cerr << "warning: " << text << "\n"; }});
  const Answerer by = {table, &device};
  const size_t entries = options.quick ? 1 << 15 : 1 << 21;
  const size_t wrong = check_answers(by, entries) + check_cells(device, entries);
  const DeviceCounts counts = device.counts();
  std::cout << entries
            << " entries of each kind of question; questions answered otherwise than by the CPU, or never by "
            << "the device: " << wrong << "; blocks by the device " << counts.blocks << ", by the CPU meanwhile "
            << counts.blocks_cpu << "\n";
  check(*runtime, runtime->open(0, kernels()), "opening the device");
  nlohmann::json report = {{"device", devices[0]},
                           {"emulated", options.emulated},
                           {"cpu_isa", isa_name(resolve_isa(Isa::automatic))},
                           {"parity", {{"entries_of_each_kind", entries}, {"wrong_questions", wrong}}},
                           {"look_ups", time_look_ups(*runtime, by, options.quick)}};
  (void)runtime->close();
  std::cout << report["look_ups"].dump(2) << "\n";
  if (!options.json.empty()) std::ofstream(options.json) << report.dump(2) << "\n";
  return wrong == 0 ? 0 : 1;
}

}  // namespace
}  // namespace fieldtrace::gpu

int main(int count, char** arguments) {
  fieldtrace::gpu::Options options;
  for (int i = 1; i < count; ++i) {
    const std::string a = arguments[i];
    if (a == "--emulated") {
      options.emulated = true;
    } else if (a == "--quick") {
      options.quick = true;
    } else if (a == "--json" && i + 1 < count) {
      options.json = arguments[++i];
    } else {
      std::cerr << "usage: gpu_check [--emulated] [--quick] [--json FILE]\n";
      return 2;
    }
  }
  try {
    return fieldtrace::gpu::run(options);
  } catch (const std::exception& e) {
    std::cerr << "gpu_check: " << e.what() << "\n";
    return std::string(e.what()).find("no CUDA dr") == std::string::npos ? 1 : 77;
  }
}
