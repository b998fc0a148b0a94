// The cells of a sky by a device: batches of many requests as one wave.
//
// Batches are cut as the CPU cuts them, since what is left out of a batch's cells depends on all of its points. A wave
// ends with the requests that bring it to k_sky_wave_cells: so what it keeps of its batches is bounded.
#include <bit>

#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "hybrid/light/sky_light.h"

namespace fieldtrace {
namespace {

// Cells of points. More than light samples: a thread sees all cells of its point, so that a million are few threads.
constexpr uint64_t k_sky_wave_cells = 4194304;

uint64_t samples_of(const SkyQuestion& question) {
  return uint64_t(question.points.size) * question.tasks->tasks().size();
}

}  // namespace

void SkyLight::ask_cells(const Request& request) {
  asked_.clear();
  for_batches(job_of(request), wanted_, [&](const Job& job) {
    begin_batch();
    occluders_.find(*sky_, centres_, job.place);
    AskedBatch& b = asked_.emplace_back();
    b.clusters.assign(job.clusters.begin(), job.clusters.end());
    b.numbers.assign(job.numbers.begin(), job.numbers.end());
    b.place = job.place;
    b.grazing = grazing_;
    for (size_t k = 0; k < occluders_.cells().size(); ++k) {
      if (occluders_.is_clear(k)) continue;
      OwnObject own;
      b.tasks.add(occluders_.task(k, own));
      b.cells.push_back(occluders_.cells()[k]);
    }
    b.tasks.link();
    b.centres.resize(centres_.size);
    b.centres.copy(0, centres_, 0, padded(centres_.size));
    b.question.points = cell_points(b.centres, grazing_);
    b.question.tasks = &b.tasks;
  });
}

void SkyLight::take_answers(const AskedBatch& batch, const Job& job) {
  const CellSums sums = clear_sums();
  const SkyQuestion& q = batch.question;
  const size_t size = size_t(q.points.size), count = batch.tasks.tasks().size();
  if (count == 0) return;
  float* const to[] = {sums.red, sums.green, sums.blue, sums.reflected_red, sums.reflected_green, sums.reflected_blue};
  for (size_t i = 0; i < 6; ++i) std::copy_n(q.sums.data() + i * size, size, to[i]);
  for (size_t t = 0; t < count; ++t) {
    const CellTask& task = batch.tasks.tasks()[t];
    job.stats.lookups += uint64_t(task.map_count + (task.own != nullptr)) * centres_.size;
    for (size_t block = 0; block < size / k_batch_padding; ++block) {
      for (uint32_t mask = q.undecided[block * count + t]; mask != 0; mask &= mask - 1) {
        const auto point = uint32_t(block * k_batch_padding) + uint32_t(std::countr_zero(mask));
        if (point < centres_.size) add_open_cell(task, batch.cells[t], point);
      }
    }
  }
}

void SkyLight::take_cells(const Request& request) {
  Job job = job_of(request);
  for (AskedBatch& b : asked_) {
    job.clusters = b.clusters;
    job.numbers = b.numbers;
    job.place = b.place;
    grazing_ = b.grazing;
    const bool is_answered = b.question.is_answered || b.tasks.tasks().empty();
    std::swap(centres_, b.centres);
    if (is_answered) {
      begin_batch();
      take_answers(b, job);
      finish_batch(job);
    } else {
      see_batch(job);
    }
    keep_arrivals(job);
    if (!context_.answerer.checks()) continue;
    if (is_answered) occluders_.find(*sky_, centres_, job.place);
    check_cells(job);
  }
  asked_.clear();
}

void SkyLight::gather_waves(std::span<const Request> requests, VisibilityDevice& device) {
  const auto for_all = [](std::span<const Request> some, const auto& work) {
    parallel_for_isolated(some.size(), [&](size_t i) {
      const ScopedTimer timer(some[i].stats.time_secondary);
      work(some[i].sky, some[i]);
    });
  };
  for_all(requests, [](SkyLight& sky, const Request& r) { sky.begin(r); });
  std::vector<Request> open(requests.begin(), requests.end());
  const auto drop_known = [&] {
    std::vector<Request> rest;
    for (const Request& r : open) {
      if (!r.sky.wanted_.empty()) rest.push_back(r);
    }
    open.swap(rest);
  };
  const auto threads = size_t(tbb::this_task_arena::max_concurrency());
  for (drop_known(); !open.empty(); drop_known()) {
    for (size_t begin = 0, end = 0; begin < open.size(); begin = end) {
      DeviceWave wave;
      for (uint64_t samples = 0; end < open.size() && samples < k_sky_wave_cells;) {
        const auto some = std::span(open).subspan(end, std::min(threads, open.size() - end));
        for_all(some, [](SkyLight& sky, const Request& r) { sky.ask_cells(r); });
        for (const Request& r : some) {
          for (AskedBatch& b : r.sky.asked_) {
            if (b.tasks.tasks().empty()) continue;
            wave.skies.push_back(&b.question);
            samples += samples_of(b.question);
          }
        }
        end += some.size();
      }
      if (!wave.empty()) device.answer(wave);
      for_all(std::span(open).subspan(begin, end - begin), [](SkyLight& sky, const Request& r) {
        sky.take_cells(r);
        sky.refine(r);
      });
    }
  }
  for_all(requests, [](SkyLight& sky, const Request& r) { sky.finish(r); });
}

}  // namespace fieldtrace
