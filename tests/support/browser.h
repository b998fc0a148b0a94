// Opens a page in a headless browser and reports what a reader would miss: images that did not load, errors of scripts.
//
// A script at the very beginning of the page records errors and, once the page is loaded, replaces the page by its
// findings, whose text the browser then prints. Thread-safety: one thread at a time.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include <nlohmann/json.hpp>

#include "tests/support/program.h"

namespace fieldtrace::test {

inline constexpr const char* k_browser = "/usr/bin/chromium";

inline bool has_browser() { return std::filesystem::exists(k_browser); }

struct PageFindings {
  int images = 0;
  std::vector<std::string> missing_images;  // alternative texts
  std::vector<std::string> errors;          // uncaught exceptions, console.error, files that did not load
};

namespace browser_detail {

// Loading errors do not bubble, so they are caught in the capturing phase.
inline constexpr const char* k_listener = R"(<script>
window.pageErrors = [];
addEventListener('error', e => pageErrors.push(e.message || 'not loaded: ' + e.target.outerHTML.slice(0, 80)), true);
addEventListener('unhandledrejection', e => pageErrors.push(String(e.reason)));
console.error = (...all) => pageErrors.push(all.join(' '));
addEventListener('load', () => {
  const images = Array.from(document.images);
  const missing = images.filter(i => !i.complete || i.naturalWidth === 0 || i.naturalHeight === 0).map(i => i.alt);
  const found = JSON.stringify({images: images.length, missing, errors: pageErrors});
  document.documentElement.textContent = 'FINDINGS' + btoa(unescape(encodeURIComponent(found))) + 'END';
});
</script>
)";

inline std::string decode_base64(const std::string& text) {
  std::string bytes;
  uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const size_t value = digits.find(c);
    if (value == std::string::npos) break;
    bits = bits << 6 | uint32_t(value);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes.push_back(char(bits >> count & 255));
  }
  return bytes;
}

}  // namespace browser_detail

// `html`: a whole page. `folder`: used by this process alone, for the page and the browser's files. Throws
// std::runtime_error with the browser's output if the page does not open.
inline PageFindings open_page(const std::string& html, const std::filesystem::path& folder) {
  const size_t head = html.find("<head>");
  if (head == std::string::npos) throw std::runtime_error("the page has no <head>");
  const size_t at = head + std::string("<head>").size();
  std::ofstream(folder / "page.html") << html.substr(0, at) << browser_detail::k_listener << html.substr(at);
  // No sandbox: it needs privileges that containers lack, and the page is our own.
  const Outcome o = Program(folder,
                            {"--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                             "--user-data-dir=" + (folder / "profile").string(), "--dump-dom",
                             "file://" + std::filesystem::absolute(folder / "page.html").string()},
                            k_browser)
                        .wait();
  const size_t begin = o.out.find("FINDINGS"), end = o.out.find("END", begin);
  if (o.code != 0 || begin == std::string::npos || end == std::string::npos) {
    throw std::runtime_error("the browser did not open the page: " + o.err);
  }
  const size_t first = begin + std::string("FINDINGS").size();
  const auto json = nlohmann::json::parse(browser_detail::decode_base64(o.out.substr(first, end - first)));
  return {json["images"], json["missing"], json["errors"]};
}

}  // namespace fieldtrace::test
