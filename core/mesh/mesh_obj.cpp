// The OBJ reader: tinyobjloader's callback parser, fed one checked line at a time.
//
// tinyobjloader reads malformed and missing numbers as 0 and reports no line numbers. So a stream buffer feeds it the
// file line by line, rejects malformed lines beforehand, and knows the current line when a callback arrives. Format:
// Wavefront, "Object Files (.obj)", Advanced Visualizer Manual, appendix B1.
#include <fmt/format.h>
#include <tiny_obj_loader.h>

#include <algorithm>
#include <cctype>
#include <istream>
#include <limits>
#include <streambuf>

#include "core/mesh/mesh_readers.h"

namespace fieldtrace::mesh_readers {
namespace {

bool is_space(char c) { return c == ' ' || c == '\t'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string_view next_word(std::string_view& line) { return mesh_readers::next_word(line, is_space); }

enum class Number { finite, not_finite, malformed };

// The numbers that tinyobjloader parses correctly: [sign] digits [. digits] [e [sign] digits].
Number classify(std::string_view word) {
  if (!word.empty() && (word.front() == '+' || word.front() == '-')) word.remove_prefix(1);
  size_t i = 0, digits = 0;
  for (; i < word.size() && (is_digit(word[i]) || (word[i] == '.' && word.find('.') == i)); ++i) {
    digits += is_digit(word[i]);
  }
  if (digits > 0 && i < word.size() && (word[i] == 'e' || word[i] == 'E')) {
    ++i;
    if (i < word.size() && (word[i] == '+' || word[i] == '-')) ++i;
    const size_t exponent = i;
    while (i < word.size() && is_digit(word[i])) ++i;
    // Longer exponents overflow the parser's int; no float needs them.
    constexpr size_t k_longest_exponent = 8;
    if (i == exponent || i - exponent > k_longest_exponent) return Number::malformed;
  }
  if (digits > 0 && i == word.size()) return Number::finite;
  // "nan", "inf", "infinity", "-nan(ind)" and Microsoft's "1.#IND", "1.#INF", "1.#QNAN".
  std::string name(word.substr(0, 3));
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return name == "nan" || name == "inf" || name == "1.#" ? Number::not_finite : Number::malformed;
}

// A face corner: v, v/t, v//n or v/t/n, or one of these with trailing slashes, as some exporters write it.
bool is_corner(std::string_view word) {
  constexpr size_t k_longest_index = 9;  // fits an int whatever the digits
  for (int part = 0; part < 3; ++part) {
    const size_t slash = std::min(word.find('/'), word.size());
    std::string_view index = word.substr(0, slash);
    if (!index.empty() && index.front() == '-') index.remove_prefix(1);
    if (index.empty() ? part == 0 || slash > 0 : index.size() > k_longest_index) return false;
    if (!std::all_of(index.begin(), index.end(), is_digit)) return false;
    // OBJ indices start at 1; the parser uses 0 for "none".
    if (!index.empty() && std::all_of(index.begin(), index.end(), [](char c) { return c == '0'; })) return false;
    if (slash == word.size()) return true;
    word.remove_prefix(slash + 1);
  }
  return false;
}

// Supplies the text one line at a time, so that line() is the line being parsed.
class LineFeed : public std::streambuf {
 public:
  LineFeed(const std::string& path, std::string_view text) : rest_(text), where_{path, 0} {
    constexpr std::string_view k_byte_order_mark = "\xEF\xBB\xBF";
    if (rest_.starts_with(k_byte_order_mark)) rest_.remove_prefix(k_byte_order_mark.size());
  }

  const SourceLocation& where() const { return where_; }
  bool not_finite() const { return not_finite_; }  // the line's numbers hold a NaN or an infinity

 protected:
  int_type underflow() override {
    if (gptr() < egptr()) return traits_type::to_int_type(*gptr());
    if (rest_.empty()) return traits_type::eof();
    where_.line = lines_taken_ + 1;
    joined_.clear();
    std::string_view line = take_line();
    const bool has_numbers = is_of_numbers(line);
    line = without_comment(line, has_numbers);
    while (line.ends_with('\\')) {  // line continuation, which the parser does not support
      joined_.append(line.substr(0, line.size() - 1)).push_back(' ');
      line = rest_.empty() ? std::string_view() : without_comment(take_line(), has_numbers);
    }
    joined_.append(line);
    check(joined_);
    drop_trailing_slashes(joined_);
    joined_.push_back('\n');
    setg(joined_.data(), joined_.data(), joined_.data() + joined_.size());
    return traits_type::to_int_type(joined_.front());
  }

 private:
  // Line ends: LF, CR LF, and CR (classic Mac OS).
  std::string_view take_line() {
    // Looked for once, however many lines end before it.
    if (to_line_feed_ == 0) to_line_feed_ = std::min(rest_.find('\n'), rest_.size());
    const size_t end = std::min(rest_.substr(0, to_line_feed_).find('\r'), to_line_feed_);
    unterminated_ = end == rest_.size();
    const std::string_view line = rest_.substr(0, end);
    const size_t next = end + (rest_.substr(end).starts_with("\r\n") ? 2 : unterminated_ ? 0 : 1);
    rest_.remove_prefix(next);
    to_line_feed_ -= std::min(next, to_line_feed_);
    ++lines_taken_;
    return line;
  }

  static bool is_of_numbers(std::string_view line) {
    const std::string_view keyword = next_word(line);
    return keyword == "v" || keyword == "vn" || keyword == "vt" || keyword == "f";
  }

  // Comments may stand behind numbers; names of groups may begin with the sign.
  static std::string_view without_comment(std::string_view line, bool has_numbers) {
    std::string_view rest = line;
    if (next_word(rest).starts_with('#')) return {};
    return has_numbers ? line.substr(0, std::min(line.find(" #"), line.find("\t#"))) : line;
  }

  // The parser would read the next corner's index in place of one missing after a slash.
  static void drop_trailing_slashes(std::string& line) {
    size_t kept = line.size();
    bool at_end = true;  // of a word
    for (size_t i = line.size(); i-- > 0;) {
      if (line[i] == '/' && at_end) continue;
      at_end = is_space(line[i]);
      line[--kept] = line[i];
    }
    line.erase(0, kept);
  }

  void check(std::string_view line) {
    not_finite_ = false;
    const std::string_view keyword = next_word(line);
    if (keyword == "v") {
      check_numbers(keyword, line, 3);
    } else if (keyword == "vn") {
      check_numbers(keyword, line, 3);
    } else if (keyword == "vt") {
      check_numbers(keyword, line, 1);
    } else if (keyword == "f") {
      check_face(line);
    }
  }

  void check_numbers(std::string_view keyword, std::string_view line, int least) {
    int count = 0;
    for (std::string_view word = next_word(line); !word.empty(); word = next_word(line), ++count) {
      const Number number = classify(word);
      if (number == Number::malformed) throw Error(where_, quote(word) + " is not a number");
      not_finite_ |= number == Number::not_finite;
    }
    if (count < least) {
      throw Error(where_, fmt::format("{} needs {} number{}, found {}{}", quote(keyword), least, least == 1 ? "" : "s",
                                      count, unterminated_ ? "; the file is cut short" : ""));
    }
  }

  void check_face(std::string_view line) {
    int count = 0;
    for (std::string_view word = next_word(line); !word.empty(); word = next_word(line), ++count) {
      if (!is_corner(word)) {
        throw Error(where_, quote(word) + " is no corner of a face, write v, v/t, v//n or v/t/n counted from 1");
      }
    }
    if (count < 3 && unterminated_) throw Error(where_, "the file ends within this face, it is cut short");
    if (count == 0) throw Error(where_, "a face without corners");
  }

  std::string_view rest_;
  SourceLocation where_;
  int lines_taken_ = 0;
  bool not_finite_ = false;
  size_t to_line_feed_ = 0;    // from the rest's beginning; 0: not known
  bool unterminated_ = false;  // the line is the file's last and has no end
  std::string joined_;
};

// Builds the mesh in the parser's callbacks.
class Builder {
 public:
  explicit Builder(const LineFeed& feed) : feed_(feed) {}

  void vertex(float x, float y, float z) {
    const Vec3 p(x, y, z);
    if (feed_.not_finite() || !(std::isfinite(x) && std::isfinite(y) && std::isfinite(z))) {
      throw Error(feed_.where(), fmt::format("vertex {} is not finite, mend the mesh", positions_.size() + 1));
    }
    positions_.push_back(p);
    latest_.push_back(k_none_yet);
  }
  void normal(float x, float y, float z) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    normals_.push_back(feed_.not_finite() ? Vec3(nan) : Vec3(x, y, z));
  }
  void texcoord(float u, float v) {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    texcoords_.push_back(feed_.not_finite() ? Vec2(nan) : Vec2(u, v));
  }
  void face(const tinyobj::index_t* corners, int count) {
    if (count < 3) {
      ++raw_.short_polygons;
      return;
    }
    const uint32_t first = corner(corners[0]);
    uint32_t previous = corner(corners[1]);
    for (int c = 2; c < count; ++c) {
      const uint32_t v = corner(corners[c]);
      raw_.mesh.triangles.push_back({first, previous, v});
      previous = v;
    }
    raw_.end_polygon(raw_.mesh.triangles.size() - size_t(count - 2), size_t(count - 2));
  }

  RawMesh finish() {
    if (!any_normal_) raw_.mesh.normals.clear();
    if (!any_texcoord_) raw_.mesh.texcoords.clear();
    return std::move(raw_);
  }

 private:
  static constexpr uint32_t k_none_yet = 0xffffffffu;
  static constexpr int k_longest_search = 64;

  // Zero-based index, or -1 for none. Negative indices count back from the latest entry.
  int64_t resolve(int index, size_t count, const char* what) const {
    if (index == 0) return -1;
    const int64_t i = index > 0 ? int64_t(index) - 1 : int64_t(count) + index;
    if (i < 0 || i >= int64_t(count)) {
      throw Error(feed_.where(),
                  fmt::format("the face refers to {} {}, but there are {} up to here", what, index, count));
    }
    return i;
  }

  // The output vertex of a position/texture/normal triple. The vertices of a position form a list, latest first, of
  // which no more is searched than a mesh needs that shares vertices at all.
  uint32_t corner(const tinyobj::index_t& c) {
    const int64_t v = resolve(c.vertex_index, positions_.size(), "vertex");
    const int64_t t = resolve(c.texcoord_index, texcoords_.size(), "texture coordinate");
    const int64_t n = resolve(c.normal_index, normals_.size(), "normal");
    uint32_t& latest = latest_[size_t(v)];
    uint32_t known = latest;
    for (int i = 0; known != k_none_yet && i < k_longest_search; ++i) {
      const Vertex& vertex = vertices_[known];
      if (vertex.texcoord == t && vertex.normal == n) return known;
      known = vertex.before;
    }
    const uint32_t id = uint32_t(vertices_.size());
    vertices_.push_back({t, n, latest});
    latest = id;
    any_texcoord_ |= t >= 0;
    any_normal_ |= n >= 0;
    raw_.mesh.positions.push_back(positions_[size_t(v)]);
    raw_.mesh.texcoords.push_back(t >= 0 ? texcoords_[size_t(t)] : Vec2(0.0f));
    raw_.mesh.normals.push_back(n >= 0 ? normals_[size_t(n)] : Vec3(0.0f));
    return id;
  }

  struct Vertex {
    int64_t texcoord, normal;
    uint32_t before;  // of the same position
  };
  const LineFeed& feed_;
  std::vector<Vec3> positions_, normals_;
  std::vector<Vec2> texcoords_;
  std::vector<uint32_t> latest_;  // for each position, its latest output vertex
  std::vector<Vertex> vertices_;
  bool any_texcoord_ = false, any_normal_ = false;
  RawMesh raw_;
};

Builder& builder(void* user) { return *static_cast<Builder*>(user); }

}  // namespace

RawMesh read_obj(const std::string& path, std::string_view text) {
  LineFeed feed(path, text);
  Builder build(feed);
  tinyobj::callback_t callbacks;
  callbacks.vertex_cb = [](void* user, float x, float y, float z, float) { builder(user).vertex(x, y, z); };
  callbacks.normal_cb = [](void* user, float x, float y, float z) { builder(user).normal(x, y, z); };
  callbacks.texcoord_cb = [](void* user, float u, float v, float) { builder(user).texcoord(u, v); };
  callbacks.index_cb = [](void* user, tinyobj::index_t* c, int count) { builder(user).face(c, count); };
  std::istream stream(&feed);
  // Otherwise the stream would swallow exceptions thrown by the feed.
  stream.exceptions(std::ios::badbit);
  std::string parser_warning, parser_error;
  if (!tinyobj::LoadObjWithCallback(stream, callbacks, &build, nullptr, &parser_warning, &parser_error)) {
    throw Error(feed.where(), "no OBJ file: " + parser_error);
  }
  return build.finish();
}

}  // namespace fieldtrace::mesh_readers
