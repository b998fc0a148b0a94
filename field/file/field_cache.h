// A folder of files of fields and direction maps, one per object and size, that renders share: `--field-cache DIR`.
//
// A file is named by its field's identity. Demand adds bricks to it: a store writes the union of the file and the
// field, and replaces the file by renaming. Writers of one file exclude one another with an advisory lock on a file
// beside it (NAME.lock, kept). Readers need none: the file they open is whole, and stays so when it is replaced or
// removed. The locks of a killed process are released, and the next writer removes its half-written files. A file that
// cannot be used causes a warning and is replaced. With a limit, the least recently used files go when a store finds
// the folder too large (field/file/cache_limit.h), but never those that this object has loaded or stored. A read-only
// folder is read, with one warning, and left as it is. Thread-safety: every function may be called from any thread, and
// any number of processes may share the folder.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>

#include "core/platform/error.h"
#include "field/file/field_identity.h"
#include "field/maps/direction_maps.h"
#include "field/thesis/thesis_field.h"

namespace fieldtrace {

class FieldCache {
 public:
  // Makes the folder if need be. Throws Error if it cannot be made, or files can neither be made nor read in it, or the
  // module for them (field/grid/vdb_grid.h) is missing: long work learns this before it starts. `warning` is
  // called from the threads that load and store, one at a time, and by the constructor if the folder holds files of
  // earlier formats or may only be read.
  explicit FieldCache(const std::string& folder, WarningSink warning = {})
      : FieldCache(folder, 0, std::move(warning)) {}
  // `most_bytes`: limit on the field files in the folder; 0: none. Once `stop` (may be null) is set nobody else's lock
  // is waited for.
  FieldCache(const std::string& folder, uint64_t most_bytes, WarningSink warning = {},
             const std::atomic<bool>* stop = nullptr);
  // Throws Error unless files can be made in the folder.
  static void require_writable_folder(const std::string& folder);

  // Adds what the cache holds of the field to `field`. False, with the field unchanged, if there is no file or none
  // that can be used; the latter causes a warning. Never throws because of a file's contents.
  bool load(Field& field, const FieldIdentity& identity);

  // Adds the field's finished slices to the cache. Writes nothing if the file is known to hold all of them, or if the
  // folder is read-only. Throws Error if the file cannot be written; or, with the file left as it is, if its contents
  // take more than half of the machine's memory, or more than memory or address space allows. A file that cannot be
  // used causes a warning, unless load() has warned of it.
  void store(const Field& field, const FieldIdentity& identity);

  // The same for a field of the thesis' chart, which is always whole: empty if there is no file that can be used. What
  // was loaded need not be stored.
  std::optional<ThesisField> load_thesis(const FieldIdentity& identity);
  void store(const ThesisField& field, const FieldIdentity& identity);
  // And for direction maps of an object within `ball`.
  std::optional<DirectionMaps> load_maps(const FieldIdentity& identity, const Sphere& ball);
  void store(const DirectionMaps& maps, const FieldIdentity& identity);

  // Says that a file is in use: this cache never removes it, and others as if it had been written now.
  void mark_used(const FieldIdentity& identity);

  // Calls `store`, which stores into this cache, on a thread of the cache's, one after another. finish() waits for all
  // of these and throws what the first has thrown that failed, after which none was called; the destructor waits, too.
  // Both are for one thread at a time.
  void store_later(std::function<void()> store);
  void finish();

  // Removes files until the folder keeps its limit; does nothing without one. To be called after all stores. Warns if
  // the remaining files exceed the limit by themselves.
  void trim();

  std::string path_of(const FieldIdentity& identity) const;
  uint64_t bytes_on_disk(const FieldIdentity& identity) const;  // 0 if there is no file

 private:
  enum class Tell { always, unless_told };
  // Hash of the slices that a file was last seen to hold, and its size then.
  struct Known {
    Hash128 slices;
    uint64_t bytes = 0;
  };
  // What `load` makes of the file at a path; for files that are whole.
  template <class Load>
  auto load_whole(const FieldIdentity& identity, const Load& load) -> std::optional<decltype(load(std::string()))>;
  template <class Save>
  void store_whole(const FieldIdentity& identity, const Save& save);
  // The file may hold what other processes added since the field was loaded.
  void merge(const Field& field, const FieldIdentity& identity, const std::string& path);
  void load_to_merge(Field& held, const FieldIdentity& identity, const std::string& path);
  bool known_complete(const Hash128& slices, const FieldIdentity& identity);
  void store_all();
  void remember(const Hash128& slices, const FieldIdentity& identity);
  void tell_unusable(const std::string& path, const std::string& reason, Tell tell);

  std::string folder_;
  uint64_t most_bytes_ = 0;
  WarningSink warning_;
  const std::atomic<bool>* stop_;
  std::mutex mutex_;
  std::map<std::string, Known> known_;  // by file name
  std::set<std::string> used_;          // file names
  std::set<std::string> told_;          // paths of unusable files already warned of
  bool read_only_ = false;
  std::deque<std::function<void()>> stores_;  // that have not begun
  bool is_storing_ = false;                   // stays so once one has failed
  std::future<void> storing_;                 // last, as its thread uses the rest until it is gone
};

}  // namespace fieldtrace
