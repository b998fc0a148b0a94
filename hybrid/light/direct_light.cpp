#include "hybrid/light/direct_light.h"

#include "core/platform/parallel.h"
#include "core/platform/stopwatch.h"
#include "hybrid/stats/secondary_timer.h"

namespace fieldtrace {
namespace {

// Lists that several threads fill, one each, as one.
template <class T>
struct PerRequest {
  explicit PerRequest(size_t count) : of(count) {}
  std::span<T> all() {
    for (std::vector<T>& list : of) {
      for (T& request : list) joined.push_back(std::move(request));
    }
    return joined;
  }
  std::vector<std::vector<T>> of;
  std::vector<T> joined;
};

}  // namespace

GroupLight& DirectLight::group(size_t i) {
  while (groups_.size() <= i) groups_.emplace_back(context_);
  return groups_[i];
}

void DirectLight::prepare(const Request& request) {
  LightReceivers& receivers = request.receivers;
  const int pixel_samples = request.first ? context_.settings.pixel_samples : 1;
  const int64_t samples = int64_t(pixel_samples) * request.light_samples;
  const auto most = uint32_t(std::max(2 * k_shadow_batch / request.light_samples, 1));
  clusters_.build(receivers, context_.light_extents, most, pixel_samples == 1 && !request.joins_pixels);
  for (auto* sum : {&receivers.arriving_red, &receivers.arriving_green, &receivers.arriving_blue}) {
    sum->assign(receivers.size(), 0.0f);
  }
  shared_.emplace(GroupLight::Shared{.receivers = receivers,
                                     .vertices = request.vertices,
                                     .clusters = clusters_,
                                     .light_samples = request.light_samples,
                                     .open_samples = request.light_samples,
                                     .pixel_samples = samples,
                                     .first = request.first,
                                     .has_sky_maps = request.first && context_.sky,
                                     .firsts = request.firsts,
                                     .stats = request.stats});
  if (request.first) shared_->open_samples = std::max(request.light_samples, context_.settings.open_light_samples);
  cut_into_groups();
}

void DirectLight::cut_into_groups() {
  begins_.clear();
  for (size_t begin = 0, end = 0; begin < clusters_.size(); begin = end) {
    begins_.push_back(begin);
    size_t samples = 0;
    for (end = begin; end < clusters_.size(); ++end) {
      samples += size_t(clusters_[end].size()) * size_t(shared_->light_samples);
      if (samples > size_t(k_shadow_batch) && end > begin) break;
    }
  }
  begins_.push_back(clusters_.size());
}

SkyLight::Request DirectLight::sky_request(const Request& r) {
  return {sky_, clusters_, r.receivers, r.vertices, r.light_samples, r.pixels, r.firsts, r.stats};
}

void DirectLight::gather_by_groups() {
  const ShadowAnswerer& answerer = context_.answerer;
  Stats& stats = shared_->stats;
  GroupLight& g = group(0);
  for (size_t i = 0; i + 1 < begins_.size(); ++i) {
    g.begin(*shared_, begins_[i], begins_[i + 1]);
    for (uint32_t light = 0; light < context_.lights.size(); ++light) {
      if (!g.begin_light(light)) continue;
      {
        const SecondaryTimer timer(stats);
        answerer.find_candidates(g.ask_candidates());
      }
      g.take_candidates();
      {
        const SecondaryTimer timer(stats);
        for (g.list_strata(); g.has_strata(); g.take_strata()) answerer.filter(g.ask_strata());
      }
      for (g.list_open(); g.has_samples(); g.take_samples()) {
        const auto request = g.ask_samples();
        const SecondaryTimer timer(stats);
        answerer.answer(request);
      }
      g.finish_light();
    }
  }
}

void DirectLight::gather_light(std::span<const Request> requests, uint32_t light) {
  const ShadowAnswerer& answerer = requests[0].direct.context_.answerer;
  std::vector<std::vector<GroupLight*>> groups(requests.size());  // that the light may reach
  parallel_for_isolated(requests.size(), [&](size_t r) {
    DirectLight& d = requests[r].direct;
    for (size_t i = 0; i + 1 < d.begins_.size(); ++i) {
      if (d.groups_[i].begin_light(light)) groups[r].push_back(&d.groups_[i]);
    }
  });
  const auto for_groups = [&](const auto& work) {
    parallel_for_isolated(requests.size(), [&](size_t r) {
      const ScopedTimer timer(requests[r].stats.time_secondary);
      for (GroupLight* g : groups[r]) work(r, *g);
    });
  };
  std::vector<ShadowAnswerer::CandidateRequest> candidates;
  for (const auto& of_request : groups) {
    for (GroupLight* g : of_request) candidates.push_back(g->ask_candidates());
  }
  answerer.find_candidates(candidates);
  PerRequest<ShadowAnswerer::FilterRequest> strata(requests.size());
  for_groups([&](size_t r, GroupLight& g) {
    g.take_candidates();
    for (g.list_strata(); g.has_strata();) strata.of[r].push_back(g.ask_strata());
  });
  answerer.filter(strata.all());
  PerRequest<ShadowAnswerer::RayRequest> rays(requests.size());
  for_groups([&](size_t r, GroupLight& g) {
    g.take_strata();
    for (g.list_open(); g.has_samples();) rays.of[r].push_back(g.ask_samples());
  });
  answerer.answer(rays.all());
  for_groups([&](size_t, GroupLight& g) {
    g.take_samples();
    g.finish_light();
  });
}

void DirectLight::gather_waves(std::span<const Request> requests) {
  if (requests.empty()) return;
  const TransportContext& context = requests[0].direct.context_;
  parallel_for_isolated(requests.size(), [&](size_t r) {
    const Request& request = requests[r];
    DirectLight& d = request.direct;
    d.prepare(request);
    for (size_t i = 0; i + 1 < d.begins_.size(); ++i) d.group(i).begin(*d.shared_, d.begins_[i], d.begins_[i + 1]);
  });
  std::vector<SkyLight::Request> skies;
  for (const Request& r : requests) {
    if (r.direct.shared_->has_sky_maps) skies.push_back(r.direct.sky_request(r));
  }
  SkyLight::gather_waves(skies, *context.answerer.device());
  for (uint32_t light = 0; light < context.lights.size(); ++light) gather_light(requests, light);
}

void DirectLight::gather(const Request& r) {
  DirectLight& d = r.direct;
  d.prepare(r);
  if (d.shared_->has_sky_maps) SkyLight::gather(d.sky_request(r));
  d.gather_by_groups();
}

}  // namespace fieldtrace
