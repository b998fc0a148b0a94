#include "field/file/cache_limit.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/io/file_lock.h"
#include "core/platform/error.h"
#include "field/file/field_identity.h"
#include "field/file/field_trailer.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

struct CachedFile {
  fs::path path = {};
  uint64_t bytes = 0;
  fs::file_time_type used = {};
  int version = 0;  // of the trailer
};

bool has_cache_name(const fs::directory_entry& entry) {
  Hash128 ignored;
  std::error_code failed;
  const fs::path& path = entry.path();
  return path.extension() == ".vdb" && parse_hash(path.stem().string(), ignored) &&
         fs::is_regular_file(entry.symlink_status(failed));
}

bool look_at(CachedFile& file) {
  std::error_code failed;
  file.bytes = fs::file_size(file.path, failed);
  if (!failed) file.used = fs::last_write_time(file.path, failed);
  return !failed;
}

std::vector<CachedFile> cached_files(const std::string& folder) {
  std::vector<CachedFile> files;
  std::error_code failed;
  for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end; entry.increment(failed)) {
    CachedFile file;
    file.path = entry->path();
    // Another process may have removed it meanwhile.
    if (!has_cache_name(*entry) || !look_at(file)) continue;
    const std::optional<int> version = trailer_version(file.path.string());
    if (!version) continue;
    file.version = *version;
    files.push_back(std::move(file));
  }
  return files;
}

// Those of fields that nobody writes now.
void remove_all_abandoned_writes(const std::string& folder) {
  std::set<std::string> fields;
  std::error_code failed;
  for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end; entry.increment(failed)) {
    const fs::path& path = entry->path();  // HASH.vdb.PROCESS-NUMBER.tmp
    const fs::path field = fs::path(path.stem()).stem();
    Hash128 ignored;
    if (path.extension() == ".tmp" && field.extension() == ".vdb" && parse_hash(field.stem().string(), ignored))
      fields.insert((fs::path(folder) / field).string());
  }
  for (const std::string& field : fields) {
    try {
      const FileLock lock(field + ".lock", LockWait::none);
      if (lock.held()) remove_abandoned_writes(field);
    } catch (const Error&) {
      continue;  // another user's
    }
  }
}

// False if the file is in use, or was used since it was listed.
bool remove_unused(const CachedFile& file) {
  try {
    const FileLock lock(file.path.string() + ".lock", LockWait::none);
    if (!lock.held()) return false;
    CachedFile now;
    now.path = file.path;
    if (!look_at(now)) return true;  // removed by another process
    std::error_code failed;
    return now.used == file.used && fs::remove(file.path, failed);
  } catch (const Error&) {
    return false;
  }
}

}  // namespace

uint64_t trim_cache(const std::string& folder, uint64_t most_bytes, const std::set<std::string>& keep,
                    const std::atomic<bool>* stop) {
  // One at a time: two processes that count the same files would both remove them, and too many in all.
  const FileLock trimming((fs::path(folder) / "trim.lock").string(), LockWait::until_free, k_longest_lock_wait, stop);
  remove_all_abandoned_writes(folder);
  std::vector<CachedFile> files = cached_files(folder);
  std::sort(files.begin(), files.end(), [](const CachedFile& a, const CachedFile& b) {
    return a.used != b.used ? a.used < b.used : a.path < b.path;
  });
  uint64_t bytes = 0;
  for (const CachedFile& file : files) bytes += file.bytes;
  for (const CachedFile& file : files) {
    if (bytes <= most_bytes) break;
    if (keep.count(file.path.filename().string()) != 0 || !remove_unused(file)) continue;
    bytes -= file.bytes;
  }
  return bytes;
}

OutdatedFiles outdated_files(const std::string& folder) {
  OutdatedFiles outdated;
  for (const CachedFile& file : cached_files(folder)) {
    if (file.version >= k_field_format_version) continue;
    ++outdated.files;
    outdated.bytes += file.bytes;
  }
  return outdated;
}

void remove_abandoned_writes(const std::string& path) {
  const fs::path target(path);
  const std::string begin = target.filename().string() + ".";
  std::vector<fs::path> abandoned;
  std::error_code failed;
  for (fs::directory_iterator entry(target.parent_path(), failed), end; !failed && entry != end;
       entry.increment(failed)) {
    const std::string name = entry->path().filename().string();
    if (name.compare(0, begin.size(), begin) == 0 && entry->path().extension() == ".tmp") {
      abandoned.push_back(entry->path());
    }
  }
  for (const fs::path& file : abandoned) fs::remove(file, failed);
}

}  // namespace fieldtrace
