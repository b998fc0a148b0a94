#include "hybrid/fields/thesis_fields.h"

#include "core/platform/error.h"
#include "field/file/keep.h"
#include "field/file/thesis_file.h"

namespace fieldtrace {
namespace {

constexpr int k_default_directions = 64;

}  // namespace

int thesis_directions(int directions, int plane) {
  if (plane != 0) {
    throw UsageError("--plane: the chart thesis has no plane; its resolution is --directions alone");
  }
  if (directions == 0) return k_default_directions;
  if (!valid_thesis_parameters({.directions = directions, .plane = 0, .lines = 0})) {
    throw UsageError("--directions " + std::to_string(directions) + ": the chart thesis has 32, 64 or 128");
  }
  return directions;
}

void require_thesis_memory(size_t objects, int m, uint64_t budget_bytes) {
  const uint64_t needed = uint64_t(objects) * thesis_samples(m);
  if (needed <= budget_bytes) return;
  throw Error("the chart thesis needs " + std::to_string(needed / 1000000) + " MB for " + std::to_string(objects) +
              (objects == 1 ? " object" : " objects") + ", more than the " + std::to_string(budget_bytes / 1000000) +
              " MB that fields may take; raise --field-memory, or lower --directions");
}

ThesisFieldSet::ThesisFieldSet(const Scene& scene, std::span<const ShapeTraits> traits, int m, uint64_t budget_bytes)
    : scene_(scene), m_(m), fields_(scene.shapes.size()) {
  for (uint32_t s = 0; s < scene.shapes.size(); ++s) {
    if (traits[s].wants_field) shapes_.push_back(s);
  }
  require_thesis_memory(shapes_.size(), m, budget_bytes);
}

bool ThesisFieldSet::make_field(uint32_t s, const Accel& accel, FieldCache* cache, const ThesisBakeCallbacks& callbacks,
                                const WarningSink& warning) {
  const FieldIdentity identity = thesis_identity(scene_.shapes[s], m_);
  if (cache) fields_[s] = cache->load_thesis(identity);
  if (fields_[s]) return true;
  fields_[s] = bake_thesis_field(accel, scene_, s, m_, callbacks, ThesisLayers::distance);
  if (!fields_[s]) return false;
  if (cache) {
    keep("the field of " + scene_.shapes[s].name, IfUnkept::warn, warning,
         [&] { cache->store(*fields_[s], identity); });
  }
  return true;
}

bool ThesisFieldSet::make(const Accel& accel, FieldCache* cache, const ThesisBakeCallbacks& callbacks,
                          const WarningSink& warning, Stats& stats) {
  BakeCounters counters;
  bool complete = true;
  for (size_t i = 0; complete && i < shapes_.size(); ++i) {
    ThesisBakeCallbacks one = callbacks;
    one.counters = &counters;
    if (callbacks.progress) {
      one.progress = [&, i](float share) { callbacks.progress((float(i) + share) / float(shapes_.size())); };
    }
    complete = make_field(shapes_[i], accel, cache, one, warning);
    if (cache) stats.field_bytes_disk += cache->bytes_on_disk(thesis_identity(scene_.shapes[shapes_[i]], m_));
  }
  if (cache) cache->trim();
  stats.add_bake(counters);
  return complete;
}

std::vector<const ThesisField*> ThesisFieldSet::pointers() const {
  std::vector<const ThesisField*> pointers;
  for (const auto& field : fields_) pointers.push_back(field ? &*field : nullptr);
  return pointers;
}

void ThesisFieldSet::count(Stats& stats) const {
  stats.field_directions = m_;
  for (const auto& field : fields_) {
    if (!field) continue;
    stats.field_objects += 1;
    stats.field_cells_baked += field->samples();
    stats.field_cells_full += field->samples();
    stats.field_bytes_memory += field->bytes();
  }
}

}  // namespace fieldtrace
