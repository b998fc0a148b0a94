// Cells of skies: the batches of a wave as one launch, with their tasks and what these refer to as one copy, whose
// pointers are made the device's.
#include <algorithm>
#include <cstddef>
#include <map>
#include <set>

#include "gpu/device_launches.h"

namespace fieldtrace::gpu {
namespace {

// Calls maps(view), radiance(view) and planes(radiance) for all that a question's tasks refer to outside of itself;
// null where they refer to none.
template <class Maps, class Radiance, class Planes>
void for_each_table(const SkyQuestion& q, const Maps& maps, const Radiance& radiance, const Planes& planes) {
  for (const OwnLines& own : q.tasks->own()) maps(own.lines.maps);
  for (const MapLines& lines : q.tasks->maps()) maps(lines.maps);
  for (const MapRadiance& r : q.tasks->own_radiance()) radiance(r.view);
  for (const MapRadiance& r : q.tasks->map_radiance()) radiance(r.view);
  for (const PlaneLines& plane : q.tasks->planes()) {
    planes(plane.radiance);
    radiance(plane.radiance ? plane.radiance->view : nullptr);
  }
}

class SkyCellsLaunch final : public SkyLaunch {
 public:
  void add(SkyQuestion& question) override {
    parts_.push_back({&question, warps_});
    warps_ += uint32_t(question.points.size) / k_warp;
    const auto add_to = [](auto& places) {
      return [&places](const auto* p) {
        if (p) places[p] = 0;
      };
    };
    for_each_table(question, add_to(maps_), add_to(radiance_), add_to(planes_));
  }

  void stage(WaveBuffers& wave) override {
    for (auto& [view, at] : maps_) {
      MapsView copy = *view;
      copy.depth = wave.tables.at<const uint8_t>(view->depth);
      copy.coverage = wave.tables.at<const uint8_t>(view->coverage);
      at = wave.in.append(&copy, sizeof copy);
    }
    for (auto& [view, at] : radiance_) {
      RadianceView copy = *view;
      copy.words = wave.tables.at<const uint8_t>(view->words);
      at = wave.in.append(&copy, sizeof copy);
    }
    for (auto& [plane, at] : planes_) {
      PlaneRadiance copy = *plane;
      at = wave.in.append(&copy, sizeof copy);
      if (plane->view) point(wave.in, at + offsetof(PlaneRadiance, view), radiance_.at(plane->view));
    }
    uint32_t masks = 0, tasks = 0;
    for (Part& p : parts_) {
      const auto count = uint32_t(p.question->tasks->tasks().size());
      p.first_mask = masks;
      p.first_task = tasks;
      masks += uint32_t(p.question->points.size) / k_warp * count;
      tasks += count;
    }
    tasks_at_ = wave.in.reserve(tasks * sizeof(CellTask));
    for (const Part& p : parts_) stage_tasks(wave.in, p);
    stage_blocks(wave.in);
    using Points = const float* CellPoints::*;
    constexpr Points k_arrays[] = {&CellPoints::px, &CellPoints::py, &CellPoints::pz, &CellPoints::gx, &CellPoints::gy,
                                   &CellPoints::gz, &CellPoints::sx, &CellPoints::sy, &CellPoints::sz};
    for (int i = 0; i < 9; ++i) {
      points_at_[i] = wave.in.reserve(size() * sizeof(float));
      float* to = wave.in.host<float>(points_at_[i]);
      for (const Part& p : parts_) to = std::copy_n(p.question->points.*k_arrays[i], p.question->points.size, to);
    }
    sums_at_ = wave.out.reserve(6 * size() * sizeof(float));
    masks_at_ = wave.out.reserve(masks * sizeof(uint32_t));
  }

  void settle(WaveBuffers& wave) override {
    for (const auto& [from, to] : pointers_) *wave.in.host<const void*>(from) = wave.in.device<const std::byte>(to);
  }

  void start(Runtime& runtime, const FieldView&, const WaveBuffers& wave) const override {
    const auto in = [&](int i) { return wave.in.device<const float>(points_at_[i]); };
    const auto sum = [&](size_t i) { return wave.out.device<float>(sums_at_) + i * size(); };
    const SkyArguments a = {wave.in.device<const CellTask>(tasks_at_),
                            wave.in.device<const SkyBlock>(blocks_at_),
                            {in(0), in(1), in(2), in(3), in(4), in(5), in(6), in(7), in(8), int32_t(size()), 0.0f},
                            {sum(0), sum(1), sum(2), sum(3), sum(4), sum(5)},
                            wave.out.device<uint32_t>(masks_at_),
                            warps_};
    start_kernel(runtime, wave, Kernel::sky_cells, a);
  }

  void take_answers(const WaveBuffers& wave) override {
    const float* const sums = wave.out.host<float>(sums_at_);
    const uint32_t* const words = wave.out.host<uint32_t>(masks_at_);
    for (const Part& p : parts_) {
      SkyQuestion& q = *p.question;
      const size_t count = size_t(q.points.size);
      q.sums.resize(6 * count);
      for (size_t i = 0; i < 6; ++i) {
        std::copy_n(sums + i * size() + p.first_warp * k_warp, count, q.sums.data() + i * count);
      }
      const uint32_t* const from = words + p.first_mask;
      q.undecided.assign(from, from + count / k_warp * q.tasks->tasks().size());
      q.is_answered = true;
    }
  }

 private:
  struct Part {
    SkyQuestion* question;
    uint32_t first_warp, first_mask = 0, first_task = 0;
  };

  size_t size() const { return size_t(warps_) * k_warp; }

  // The pointer at `from` shall be the place `to` on the device.
  void point(StagingBuffer& in, size_t from, size_t to) {
    *in.host<const void*>(from) = nullptr;
    pointers_.emplace_back(from, to);
  }

  // Copies a list, and makes what `member` of each refers to the place that it has.
  template <class T, class Table, class Places>
  size_t stage_list(StagingBuffer& in, std::span<const T> list, size_t member, const Table* T::*table,
                    const Places& places) {
    const size_t at = in.append(list.data(), list.size_bytes());
    for (size_t i = 0; i < list.size(); ++i) {
      if (list[i].*table) point(in, at + i * sizeof(T) + member, places.at(list[i].*table));
    }
    return at;
  }

  void stage_tasks(StagingBuffer& in, const Part& part) {
    const CellTasks& t = *part.question->tasks;
    const size_t own = in.append(t.own().data(), t.own().size_bytes());
    for (size_t i = 0; i < t.own().size(); ++i) {
      const MapsView* const view = t.own()[i].lines.maps;
      if (view) {
        point(in, own + i * sizeof(OwnLines) + offsetof(OwnLines, lines) + offsetof(MapLines, maps), maps_.at(view));
      }
    }
    const size_t maps = stage_list(in, t.maps(), offsetof(MapLines, maps), &MapLines::maps, maps_);
    const auto radiance = [&](std::span<const MapRadiance> list) {
      return stage_list(in, list, offsetof(MapRadiance, view), &MapRadiance::view, radiance_);
    };
    const size_t own_radiance = radiance(t.own_radiance()), map_radiance = radiance(t.map_radiance());
    const size_t planes = stage_list(in, t.planes(), offsetof(PlaneLines, radiance), &PlaneLines::radiance, planes_);
    const size_t balls = in.append(t.balls().data(), t.balls().size_bytes());
    const size_t tasks = tasks_at_ + part.first_task * sizeof(CellTask);
    std::copy(t.tasks().begin(), t.tasks().end(), in.host<CellTask>(tasks));
    for (size_t k = 0; k < t.tasks().size(); ++k) {
      const CellTask& task = t.tasks()[k];
      const size_t at = tasks + k * sizeof(CellTask);
      // The place of what the task refers to lies as far into its list as on the host.
      const auto point_into = [&](size_t member, const auto* first, const auto& list, size_t list_at) {
        if (first) point(in, at + member, list_at + size_t(first - list.data()) * sizeof *first);
      };
      point_into(offsetof(CellTask, own), task.own, t.own(), own);
      point_into(offsetof(CellTask, maps), task.maps, t.maps(), maps);
      point_into(offsetof(CellTask, own_radiance), task.own_radiance, t.own_radiance(), own_radiance);
      point_into(offsetof(CellTask, map_radiance), task.map_radiance, t.map_radiance(), map_radiance);
      point_into(offsetof(CellTask, planes), task.planes, t.planes(), planes);
      point_into(offsetof(CellTask, balls), task.balls, t.balls(), balls);
    }
  }

  void stage_blocks(StagingBuffer& in) {
    blocks_at_ = in.reserve(warps_ * sizeof(SkyBlock));
    SkyBlock* to = in.host<SkyBlock>(blocks_at_);
    for (const Part& p : parts_) {
      const auto cells = uint32_t(p.question->tasks->tasks().size());
      for (uint32_t b = 0; b < uint32_t(p.question->points.size) / k_warp; ++b) {
        *to++ = {p.first_task, cells, p.first_mask + b * cells, p.question->points.grazing};
      }
    }
  }

  std::vector<Part> parts_;
  uint32_t warps_ = 0;
  // Places in the wave's `in`.
  std::map<const MapsView*, size_t> maps_;
  std::map<const RadianceView*, size_t> radiance_;
  std::map<const PlaneRadiance*, size_t> planes_;
  std::vector<std::pair<size_t, size_t>> pointers_;
  size_t tasks_at_ = 0, blocks_at_ = 0, points_at_[9], sums_at_ = 0, masks_at_ = 0;
};

}  // namespace

std::unique_ptr<SkyLaunch> make_sky_launch() { return std::make_unique<SkyCellsLaunch>(); }

void list_sky_tables(const SkyQuestion& question, std::vector<HostTable>& tables) {
  std::set<const void*> listed;
  const auto is_new = [&](const void* view) { return view && listed.insert(view).second; };
  const auto add_maps = [&](const MapsView* view) {
    if (!is_new(view)) return;
    tables.push_back({view->depth, size_t(view->depth_bytes) * size_t(view->directions)});
    tables.push_back({view->coverage, size_t(view->coverage_bytes) * size_t(view->directions)});
  };
  const auto add_radiance = [&](const RadianceView* view) {
    if (is_new(view)) tables.push_back({view->words, size_t(view->bytes) * size_t(view->count)});
  };
  for_each_table(question, add_maps, add_radiance, [](const PlaneRadiance*) {});
}

}  // namespace fieldtrace::gpu
