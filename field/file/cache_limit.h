// Keeping a field cache small: which files go when a folder holds too much.
//
// Only files made by a cache count: named as FieldIdentity::file_name() names them, and ending as a field file ends
// (field/file/field_file.h). All others, fields under the user's own names included, are neither counted nor removed,
// but for what killed processes have half written. A file's last use is its modification time, which FieldCache sets
// when it reads or writes the file. Thread-safety: any number of threads and processes may trim one folder, beside
// others that use it.
#pragma once

#include <atomic>
#include <cstdint>
#include <set>
#include <string>

namespace fieldtrace {

// Removes the least recently used files of `folder` until the others take at most `most_bytes`. Files named in `keep`
// stay, as do files that are locked at the moment or cannot be removed. Returns the bytes of what stays. Throws Error
// if others trim the folder all the while that it waits for them (FileLock; `stop` may be null).
uint64_t trim_cache(const std::string& folder, uint64_t most_bytes, const std::set<std::string>& keep,
                    const std::atomic<bool>* stop = nullptr);

// Field files of earlier formats, which this program cannot read and whose names it no longer looks for. Another
// version that shares the folder may still use them, so only trim_cache() removes them. Throws nothing.
struct OutdatedFiles {
  uint64_t files = 0, bytes = 0;
};
OutdatedFiles outdated_files(const std::string& folder);

// Removes what an ended process left of writing `path` under temporary names. Unchecked: the caller holds the lock that
// writers of `path` take.
void remove_abandoned_writes(const std::string& path);

}  // namespace fieldtrace
