#include "field/file/field_cache.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <new>
#include <system_error>
#include <utility>

#include "core/io/atomic_file.h"
#include "core/io/file_lock.h"
#include "core/io/input_file.h"
#include "core/platform/address_space.h"
#include "core/platform/machine_memory.h"
#include "core/platform/module.h"
#include "field/file/cache_limit.h"
#include "field/file/field_file.h"
#include "field/file/maps_file.h"
#include "field/file/thesis_file.h"
#include "field/grid/vdb_grid.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

bool holds_all_of(const Field& all, const Field& some) {
  for (const BrickPlace& place : some.bricks()) {
    const uint32_t brick = all.brick_at(place.direction_brick, place.plane_brick);
    if (brick == 0 || (place.finished & ~all.finished_mask(brick)) != 0) return false;
  }
  const std::vector<uint32_t> tiles = some.coverage().baked();
  return std::all_of(tiles.begin(), tiles.end(), [&](uint32_t slot) { return all.coverage().finished(slot); });
}

uint64_t size_of_file(const std::string& path) {
  std::error_code failed;
  const uint64_t bytes = fs::file_size(path, failed);
  return failed ? 0 : bytes;
}

}  // namespace

FieldCache::FieldCache(const std::string& folder, uint64_t most_bytes, WarningSink warning,
                       const std::atomic<bool>* stop)
    : folder_(folder), most_bytes_(most_bytes), warning_(std::move(warning)), stop_(stop) {
  require_module(k_vdb_module);  // long work learns here, not at its end, if it is missing
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (!is_folder(folder)) {
    throw Error({folder}, "cannot be made a folder for fields" + (failed ? ": " + failed.message() : std::string()) +
                              "; name a folder that you may write to");
  }
  try {
    require_writable_folder(folder);
  } catch (const Error& e) {
    if (access(folder.c_str(), R_OK | X_OK) != 0) throw;
    read_only_ = true;
    warn(warning_, {}, std::string(e.what()) + "; fields are read from this folder, but none is kept");
  }
  const OutdatedFiles outdated = outdated_files(folder);
  if (outdated.files == 0) return;
  warn(warning_, {folder},
       "holds " + std::to_string(outdated.files) + " field file" + (outdated.files == 1 ? "" : "s") + " (" +
           std::to_string(outdated.bytes) + " bytes) of an earlier format than " +
           std::to_string(k_field_format_version) +
           ", which cannot be used; their fields are baked again; delete the files, or give --field-cache-limit");
}

void FieldCache::require_writable_folder(const std::string& folder) {
  // No name that users give to folders.
  const std::string probe = (fs::path(folder) / ".fieldtrace-probe").string();
  try {
    require_writable(probe);
  } catch (const Error& e) {
    throw Error({folder}, std::string(e.what()).substr(probe.size() + 2));  // behind "PROBE: "
  }
}

std::string FieldCache::path_of(const FieldIdentity& identity) const {
  return (fs::path(folder_) / identity.file_name()).string();
}

uint64_t FieldCache::bytes_on_disk(const FieldIdentity& identity) const { return size_of_file(path_of(identity)); }

void FieldCache::tell_unusable(const std::string& path, const std::string& reason, Tell tell) {
  const std::lock_guard lock(mutex_);
  if (!told_.insert(path).second && tell == Tell::unless_told) return;
  warn(warning_, {path}, reason + "; it is not used and will be baked again");
}

bool FieldCache::known_complete(const Hash128& slices, const FieldIdentity& identity) {
  const std::lock_guard lock(mutex_);
  const auto known = known_.find(identity.file_name());
  return known != known_.end() && known->second.slices == slices &&
         known->second.bytes == size_of_file(path_of(identity));
}

void FieldCache::remember(const Hash128& slices, const FieldIdentity& identity) {
  const std::lock_guard lock(mutex_);
  known_[identity.file_name()] = {slices, size_of_file(path_of(identity))};
}

// The modification time stands for the last use: many file systems do not keep access times.
void FieldCache::mark_used(const FieldIdentity& identity) {
  const std::lock_guard lock(mutex_);
  used_.insert(identity.file_name());
  std::error_code ignored;  // there is no file yet, or it belongs to another user
  fs::last_write_time(path_of(identity), fs::file_time_type::clock::now(), ignored);
}

// Files that do not fit into memory are left as they are: replaced by this field alone, a file would lose what others
// have baked.
void FieldCache::load_to_merge(Field& held, const FieldIdentity& identity, const std::string& path) {
  try {
    if (size_of_file(path) > machine_memory_bytes()) throw std::bad_alloc();
    remember(load_field(held, identity, path).slices, identity);
  } catch (const FieldFileError& e) {
    tell_unusable(path, e.reason(), Tell::unless_told);
  } catch (const std::bad_alloc&) {
    throw Error({path}, "is larger than memory allows, and is left as it is");
  }
  if (held.budget()->out_of_addresses()) {
    throw Error({path},
                "takes more address space than may be reserved, and is left as it is; raise the limit, ulimit -v");
  }
  if (held.budget()->exceeded()) {
    throw Error({path}, "holds more than half of this machine's memory, and is left as it is");
  }
}

void FieldCache::merge(const Field& field, const FieldIdentity& identity, const std::string& path) {
  FieldBudget budget(machine_memory_bytes() / 2);
  std::optional<Field> held;
  std::vector<const Field*> all = {&field};
  std::error_code failed;
  if (fs::exists(path, failed)) {
    held.emplace(field.ball(), field.parameters(), &budget, reservable_bytes());
    load_to_merge(*held, identity, path);
    all.push_back(&*held);
  }
  if (!held || !holds_all_of(*held, field)) save_fields(all, identity, path);
}

template <class Load>
auto FieldCache::load_whole(const FieldIdentity& identity, const Load& load)
    -> std::optional<decltype(load(std::string()))> {
  const std::string path = path_of(identity);
  std::error_code failed;
  if (!fs::exists(path, failed)) return std::nullopt;
  mark_used(identity);
  try {
    return load(path);
  } catch (const MissingFieldFile&) {  // another process has removed it since, to keep the folder's limit
  } catch (const FieldFileError& e) {
    tell_unusable(path, e.reason(), Tell::always);
  } catch (const std::bad_alloc&) {
    tell_unusable(path, "is larger than memory allows", Tell::always);
  }
  return std::nullopt;
}

template <class Save>
void FieldCache::store_whole(const FieldIdentity& identity, const Save& save) {
  if (read_only_) return;
  mark_used(identity);
  const std::string path = path_of(identity);
  const FileLock lock(path + ".lock", LockWait::until_free, k_longest_lock_wait, stop_);
  remove_abandoned_writes(path);
  save(path);
}

void FieldCache::store(const Field& field, const FieldIdentity& identity) {
  if (read_only_ || field.cells_baked() + field.coverage().lines_baked() == 0) return;
  const Hash128 slices = slices_hash(field);
  if (known_complete(slices, identity)) {
    mark_used(identity);
    return;
  }
  store_whole(identity, [&](const std::string& path) {
    merge(field, identity, path);
    remember(slices, identity);
  });
}

bool FieldCache::load(Field& field, const FieldIdentity& identity) {
  const auto load_and_remember = [&](const std::string& path) {
    remember(load_field(field, identity, path).slices, identity);
    return true;
  };
  return load_whole(identity, load_and_remember).has_value();
}

std::optional<ThesisField> FieldCache::load_thesis(const FieldIdentity& identity) {
  return load_whole(identity, [&](const std::string& path) { return load_thesis_field(identity, path); });
}

void FieldCache::store(const ThesisField& field, const FieldIdentity& identity) {
  store_whole(identity, [&](const std::string& path) { save_thesis_field(field, identity, path); });
}

std::optional<DirectionMaps> FieldCache::load_maps(const FieldIdentity& identity, const Sphere& ball) {
  return load_whole(identity, [&](const std::string& path) { return load_direction_maps(identity, ball, path); });
}

void FieldCache::store(const DirectionMaps& maps, const FieldIdentity& identity) {
  store_whole(identity, [&](const std::string& path) { save_direction_maps(maps, identity, path); });
}

void FieldCache::store_later(std::function<void()> store) {
  {
    const std::lock_guard lock(mutex_);
    stores_.push_back(std::move(store));
    if (is_storing_) return;
    is_storing_ = true;
  }
  try {
    storing_ = std::async(std::launch::async, [this] { store_all(); });
  } catch (const std::system_error&) {  // there are too many threads
    store_all();
  }
}

void FieldCache::store_all() {
  for (;;) {
    std::function<void()> store;
    {
      const std::lock_guard lock(mutex_);
      if (stores_.empty()) {
        is_storing_ = false;
        return;
      }
      store = std::move(stores_.front());
      stores_.pop_front();
    }
    store();
  }
}

void FieldCache::finish() {
  if (storing_.valid()) storing_.get();
}

void FieldCache::trim() {
  if (most_bytes_ == 0 || read_only_) return;
  const std::lock_guard lock(mutex_);
  try {
    const uint64_t left = trim_cache(folder_, most_bytes_, used_, stop_);
    if (left <= most_bytes_) return;
    warn(warning_, {folder_},
         "holds " + std::to_string(left) + " bytes of fields that are in use, more than its limit of " +
             std::to_string(most_bytes_) + "; raise --field-cache-limit, or use another folder");
  } catch (const Error& e) {
    warn(warning_, {}, std::string(e.what()) + "; the limit of " + folder_ + " is not kept");
  }
}

}  // namespace fieldtrace
