// Cells of a sky for a batch of points: tasks and what they refer to as one copy, whose pointers are made the device's.
#include <algorithm>
#include <cstddef>
#include <map>

#include "gpu/device_launches.h"

namespace fieldtrace::gpu {
namespace {

class SkyLaunch final : public KernelLaunch {
 public:
  explicit SkyLaunch(SkyQuestion& question)
      : KernelLaunch(nullptr), q_(question), tasks_(question.tasks), warps_(uint32_t(question.points.size) / k_warp) {
    for (const CellTask& task : tasks_) look_at(task);
  }

  void list(std::vector<HostTable>& tables) const {
    for (const auto& [view, at] : maps_) {
      tables.push_back({view->depth, size_t(view->depth_bytes) * size_t(view->directions)});
      tables.push_back({view->coverage, size_t(view->coverage_bytes) * size_t(view->directions)});
    }
    for (const auto& [view, at] : radiance_) {
      tables.push_back({view->words, size_t(view->bytes) * size_t(view->count)});
    }
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
      point(wave.in, at + offsetof(PlaneRadiance, view), radiance_[plane->view]);
    }
    tasks_at_ = wave.in.append(tasks_.data(), tasks_.size_bytes());
    for (size_t k = 0; k < tasks_.size(); ++k) stage_task(wave.in, tasks_[k], tasks_at_ + k * sizeof(CellTask));
    const CellPoints& p = q_.points;
    const float* const arrays[] = {p.px, p.py, p.pz, p.gx, p.gy, p.gz, p.sx, p.sy, p.sz};
    for (int i = 0; i < 9; ++i) points_at_[i] = wave.in.append(arrays[i], size_t(p.size) * sizeof(float));
    sums_at_ = wave.out.reserve(6 * size_t(p.size) * sizeof(float));
    masks_at_ = wave.out.reserve(warps_ * tasks_.size() * sizeof(uint32_t));
  }

  void settle(WaveBuffers& wave) override {
    for (const auto& [from, to] : pointers_) *wave.in.host<const void*>(from) = wave.in.device<const std::byte>(to);
  }

  void start(Runtime& runtime, const FieldView&, const WaveBuffers& wave) const override {
    const int32_t size = q_.points.size;
    const auto in = [&](int i) { return wave.in.device<const float>(points_at_[i]); };
    const auto sum = [&](int i) { return wave.out.device<float>(sums_at_) + i * size; };
    const SkyArguments a = {wave.in.device<const CellTask>(tasks_at_),
                            uint32_t(tasks_.size()),
                            {in(0), in(1), in(2), in(3), in(4), in(5), in(6), in(7), in(8), size, q_.points.grazing},
                            {sum(0), sum(1), sum(2), sum(3), sum(4), sum(5)},
                            wave.out.device<uint32_t>(masks_at_),
                            warps_};
    start_kernel(runtime, wave, Kernel::sky_cells, a);
  }

  void take_answers(const WaveBuffers& wave) override {
    const float* const from = wave.out.host<float>(sums_at_);
    q_.sums.assign(from, from + 6 * size_t(q_.points.size));
    const uint32_t* const words = wave.out.host<uint32_t>(masks_at_);
    q_.undecided.assign(words, words + warps_ * tasks_.size());
    q_.is_answered = true;
  }

 private:
  // Notes the tables of a task.
  void look_at(const CellTask& task) {
    const auto add = [](auto& places, const auto* p) {
      if (p) places[p] = 0;
    };
    if (task.own) add(maps_, task.own->lines.maps);
    for (int k = 0; k < task.map_count; ++k) add(maps_, task.maps[k].maps);
    if (task.own_radiance) add(radiance_, task.own_radiance->view);
    for (int k = 0; task.map_radiance && task.reflects && k < task.map_count; ++k) {
      add(radiance_, task.map_radiance[k].view);
    }
    for (int k = 0; k < task.plane_count; ++k) {
      add(planes_, task.planes[k].radiance);
      if (task.planes[k].radiance) add(radiance_, task.planes[k].radiance->view);
    }
  }

  // The pointer at `from` shall be the place `to` on the device.
  void point(StagingBuffer& in, size_t from, size_t to) {
    *in.host<const void*>(from) = nullptr;
    pointers_.emplace_back(from, to);
  }
  template <class T, class Place>
  void point_to(StagingBuffer& in, size_t from, const T* table, const Place& places) {
    if (table) point(in, from, places.at(table));
  }

  void stage_task(StagingBuffer& in, const CellTask& task, size_t at) {
    if (task.own) {
      const size_t own = in.append(task.own, sizeof *task.own);
      point_to(in, own + offsetof(OwnLines, lines) + offsetof(MapLines, maps), task.own->lines.maps, maps_);
      point(in, at + offsetof(CellTask, own), own);
    }
    if (task.own_radiance) {
      const size_t own = in.append(task.own_radiance, sizeof *task.own_radiance);
      point_to(in, own + offsetof(MapRadiance, view), task.own_radiance->view, radiance_);
      point(in, at + offsetof(CellTask, own_radiance), own);
    }
    const size_t lines = in.append(task.maps, size_t(task.map_count) * sizeof(MapLines));
    const bool reflects = task.reflects && task.map_radiance;
    const size_t back = in.append(task.map_radiance, reflects ? size_t(task.map_count) * sizeof(MapRadiance) : 0);
    for (int k = 0; k < task.map_count; ++k) {
      const size_t i = size_t(k);
      point_to(in, lines + i * sizeof(MapLines) + offsetof(MapLines, maps), task.maps[k].maps, maps_);
      if (!reflects) continue;
      point_to(in, back + i * sizeof(MapRadiance) + offsetof(MapRadiance, view), task.map_radiance[k].view, radiance_);
    }
    const size_t plane = in.append(task.planes, size_t(task.plane_count) * sizeof(PlaneLines));
    for (int k = 0; k < task.plane_count; ++k) {
      point_to(in, plane + size_t(k) * sizeof(PlaneLines) + offsetof(PlaneLines, radiance), task.planes[k].radiance,
               planes_);
    }
    point(in, at + offsetof(CellTask, maps), lines);
    point(in, at + offsetof(CellTask, map_radiance), back);
    point(in, at + offsetof(CellTask, planes), plane);
    point(in, at + offsetof(CellTask, balls), in.append(task.balls, size_t(task.ball_count) * sizeof(BallLines)));
  }

  SkyQuestion& q_;
  const std::span<const CellTask> tasks_;
  const uint32_t warps_;
  // Places in the wave's `in`.
  std::map<const MapsView*, size_t> maps_;
  std::map<const RadianceView*, size_t> radiance_;
  std::map<const PlaneRadiance*, size_t> planes_;
  std::vector<std::pair<size_t, size_t>> pointers_;
  size_t tasks_at_ = 0, points_at_[9], sums_at_ = 0, masks_at_ = 0;
};

}  // namespace

std::unique_ptr<KernelLaunch> sky_launch(SkyQuestion& question) { return std::make_unique<SkyLaunch>(question); }

void list_sky_tables(SkyQuestion& question, std::vector<HostTable>& tables) { SkyLaunch(question).list(tables); }

}  // namespace fieldtrace::gpu
