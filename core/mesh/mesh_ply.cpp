// The PLY parser. Format: G. Turk, "The PLY Polygon File Format", Stanford University, 1994.
// Why it is hand-written: docs/decisions/001-ply-reader.md.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstring>
#include <optional>

#include "core/io/number_text.h"
#include "core/mesh/mesh_readers.h"

namespace fieldtrace::mesh_readers {
namespace {

enum class Type : uint8_t { i8, u8, i16, u16, i32, u32, f32, f64 };
constexpr size_t k_sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};

struct Property {
  std::string name;
  Type type = Type::f32;
  bool list = false;
  Type count_type = Type::u8;  // for lists
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
  int line = 0;
};

enum class Format { unknown, ascii, little_endian, big_endian };

struct Header {
  Format format = Format::unknown;
  std::vector<Element> elements;
  size_t body = 0;    // offset of the first byte after the header
  int body_line = 1;  // its line

  const Element* find(std::string_view name) const {
    for (const Element& e : elements) {
      if (e.name == name) return &e;
    }
    return nullptr;
  }
};

// ---------------------------------------------------------------- header

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

std::string_view next_word(std::string_view& line) { return mesh_readers::next_word(line, is_blank); }

class HeaderParser {
 public:
  HeaderParser(const std::string& path, std::string_view bytes) : bytes_(bytes), where_{path, 0} {}

  Header parse() {
    std::string_view line = next_line();
    if (next_word(line) != "ply" || !next_word(line).empty()) fail("does not begin with \"ply\", this is no PLY file");
    for (;;) {
      line = next_line();
      const std::string_view keyword = next_word(line);
      if (keyword == "end_header") break;
      if (keyword.empty() || keyword == "comment" || keyword == "obj_info") continue;
      if (keyword == "format") {
        parse_format(line);
      } else if (keyword == "element") {
        parse_element(line);
      } else if (keyword == "property") {
        parse_property(line);
      } else {
        fail("unknown word " + quote(keyword) + " in the PLY header");
      }
    }
    if (header_.format == Format::unknown) fail("the PLY header has no format line");
    header_.body = at_;
    header_.body_line = where_.line + 1;
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& message) const { throw Error(where_, message); }

  std::string_view next_line() {
    if (at_ >= bytes_.size()) fail("the PLY header has no end_header line, the file is cut short or no PLY file");
    ++where_.line;
    const size_t end = std::min(bytes_.find('\n', at_), bytes_.size());
    const std::string_view line = bytes_.substr(at_, end - at_);
    at_ = std::min(end + 1, bytes_.size());
    return line;
  }

  void parse_format(std::string_view line) {
    const std::string_view name = next_word(line);
    if (header_.format != Format::unknown) fail("second format line");
    if (name == "ascii") {
      header_.format = Format::ascii;
    } else if (name == "binary_little_endian") {
      header_.format = Format::little_endian;
    } else if (name == "binary_big_endian") {
      header_.format = Format::big_endian;
    } else {
      fail("unknown PLY format " + quote(name) + ", use ascii, binary_little_endian or binary_big_endian");
    }
    const std::string_view version = next_word(line);
    if (version != "1.0") fail("unknown PLY version " + quote(version) + ", only 1.0 exists");
  }

  void parse_element(std::string_view line) {
    Element e;
    e.name = next_word(line);
    e.line = where_.line;
    const std::string_view count = next_word(line);
    const auto [end, ec] = std::from_chars(count.data(), count.data() + count.size(), e.count);
    if (e.name.empty() || ec != std::errc() || end != count.data() + count.size() || !next_word(line).empty()) {
      fail("an element line reads \"element NAME COUNT\"");
    }
    if (header_.find(e.name)) fail("second element " + quote(e.name));
    header_.elements.push_back(std::move(e));
  }

  Type parse_type(std::string_view word) const {
    struct Name {
      std::string_view name;
      Type type;
    };
    static constexpr Name k_names[] = {
        {"char", Type::i8},   {"uchar", Type::u8},   {"short", Type::i16},   {"ushort", Type::u16},
        {"int", Type::i32},   {"uint", Type::u32},   {"float", Type::f32},   {"double", Type::f64},
        {"int8", Type::i8},   {"uint8", Type::u8},   {"int16", Type::i16},   {"uint16", Type::u16},
        {"int32", Type::i32}, {"uint32", Type::u32}, {"float32", Type::f32}, {"float64", Type::f64}};
    for (const Name& n : k_names) {
      if (n.name == word) return n.type;
    }
    fail("unknown PLY type " + quote(word));
  }

  void parse_property(std::string_view line) {
    if (header_.elements.empty()) fail("a property before the first element");
    Property p;
    std::string_view word = next_word(line);
    if (word == "list") {
      p.list = true;
      p.count_type = parse_type(next_word(line));
      if (p.count_type >= Type::f32) fail("the length of a list must have a whole type");
      word = next_word(line);
    }
    p.type = parse_type(word);
    p.name = next_word(line);
    if (p.name.empty() || !next_word(line).empty()) {
      fail("a property line reads \"property TYPE NAME\" or \"property list TYPE TYPE NAME\"");
    }
    std::vector<Property>& all = header_.elements.back().properties;
    for (const Property& other : all) {
      if (other.name == p.name) fail("second property " + quote(p.name) + " of the element");
    }
    all.push_back(std::move(p));
  }

  std::string_view bytes_;
  SourceLocation where_;
  size_t at_ = 0;
  Header header_;
};

// ---------------------------------------------------------------- values

// Both sources supply one value after another, as double (exact for every PLY type). A record is one vertex, face, ...
class AsciiSource {
 public:
  AsciiSource(const std::string& path, std::string_view body, int line) : rest_(body), where_{path, line - 1} {}

  const SourceLocation& where() const { return where_; }
  size_t bytes_left() const { return rest_.size(); }
  // A value takes at least a digit and a separator.
  static constexpr uint64_t least_bytes(Type) { return 2; }

  void begin_record(const Element& e, uint64_t index) {
    do {
      if (rest_.empty()) {
        throw Error(where_, fmt::format("the file ends after {} of {} records of element {}, it is cut short", index,
                                        e.count, quote(e.name)));
      }
      const size_t end = std::min(rest_.find('\n'), rest_.size());
      line_ = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++where_.line;
      while (!line_.empty() && is_blank(line_.front())) line_.remove_prefix(1);
    } while (line_.empty());
  }

  double value(Type) {
    const std::string_view word = next_word(line_);
    if (word.empty()) {
      throw Error(where_, rest_.empty() ? "the file ends within this line, it is cut short"
                                        : "fewer values than the header announces, add the missing ones");
    }
    const std::optional<double> v = parse_double(word);
    if (!v) throw Error(where_, quote(word) + " is not a number");
    return *v;
  }

  void end_record() {
    if (const std::string_view word = next_word(line_); !word.empty()) {
      throw Error(where_, "more values than the header announces, from " + quote(word) + " on");
    }
  }

  void finish(const WarningSink& warning) {
    if (rest_.find_first_not_of(" \t\r\n\v\f") != std::string_view::npos) {
      warn(warning, {where_.file, where_.line + 1}, "what follows the last element is ignored");
    }
  }

 private:
  std::string_view rest_, line_;
  SourceLocation where_;
};

template <bool SwapBytes>
class BinarySource {
 public:
  BinarySource(const std::string& path, std::string_view body) : rest_(body), where_{path, 0} {}

  const SourceLocation& where() const { return where_; }
  size_t bytes_left() const { return rest_.size(); }
  static constexpr uint64_t least_bytes(Type t) { return k_sizes[size_t(t)]; }

  void begin_record(const Element& e, uint64_t index) {
    element_ = &e;
    index_ = index;
  }
  void end_record() {}

  double value(Type t) {
    switch (t) {
      case Type::i8:
        return read<int8_t>();
      case Type::u8:
        return read<uint8_t>();
      case Type::i16:
        return read<int16_t>();
      case Type::u16:
        return read<uint16_t>();
      case Type::i32:
        return read<int32_t>();
      case Type::u32:
        return read<uint32_t>();
      case Type::f32:
        return double(read<float>());
      default:
        return read<double>();
    }
  }

  void finish(const WarningSink& warning) {
    if (!rest_.empty()) {
      warn(warning, where_, fmt::format("{} bytes after the last element are ignored", rest_.size()));
    }
  }

 private:
  template <class T>
  T read() {
    if (rest_.size() < sizeof(T)) {
      throw Error(where_, fmt::format("the file ends within record {} of {} of element {}, it is cut short", index_,
                                      element_->count, quote(element_->name)));
    }
    std::array<char, sizeof(T)> raw;
    for (size_t i = 0; i < sizeof(T); ++i) raw[i] = rest_[SwapBytes ? sizeof(T) - 1 - i : i];
    rest_.remove_prefix(sizeof(T));
    return std::bit_cast<T>(raw);
  }

  std::string_view rest_;
  SourceLocation where_;
  const Element* element_ = nullptr;
  uint64_t index_ = 0;
};

// ---------------------------------------------------------------- elements

// Throws unless the rest of the file can hold the element: a corrupt count must not cause huge allocations or loops.
template <class Source>
void check_room(const Source& source, const Element& e) {
  uint64_t record = 0;
  for (const Property& p : e.properties) record += Source::least_bytes(p.list ? p.count_type : p.type);
  // + 1: the last separator of an ascii file may be missing.
  if (record > 0 && e.count > (uint64_t(source.bytes_left()) + 1) / record) {
    throw Error(
        {source.where().file, e.line},
        fmt::format("{} records of element {} need at least {} bytes each, but only {} bytes follow; the file is "
                    "cut short or damaged",
                    e.count, quote(e.name), record, source.bytes_left()));
  }
}

template <class Source>
uint64_t read_count(Source& source, const Property& p) {
  const double n = source.value(p.count_type);
  if (!(n >= 0.0 && n <= double(k_max_vertices) && n == std::floor(n))) {
    throw Error(source.where(), fmt::format("{:g} is no length of list {}", n, quote(p.name)));
  }
  return uint64_t(n);
}

template <class Source>
void skip(Source& source, const Property& p) {
  const uint64_t n = p.list ? read_count(source, p) : 1;
  for (uint64_t i = 0; i < n; ++i) source.value(p.type);
}

template <class Source>
void read_vertices(Source& source, const Element& e, TriangleMesh& mesh) {
  // Slots: 0..2 position, 3..5 normal, 6..7 texture coordinate.
  constexpr int k_slots = 8, k_skipped = k_slots;
  std::array<std::string_view, k_slots> names = {"x", "y", "z", "nx", "ny", "nz", "u", "v"};
  const auto has = [&](std::string_view name) {
    return std::any_of(e.properties.begin(), e.properties.end(),
                       [&](const Property& p) { return p.name == name && !p.list; });
  };
  // The first pair that is whole, in Mitsuba's order.
  static constexpr std::string_view k_pairs[][2] = {{"u", "v"}, {"texture_u", "texture_v"}, {"s", "t"}};
  for (const auto& [u, v] : k_pairs) {
    if (!has(u) || !has(v)) continue;
    names[6] = u, names[7] = v;
    break;
  }
  std::vector<int> slots(e.properties.size(), k_skipped);
  bool found[k_slots] = {};
  for (size_t i = 0; i < slots.size(); ++i) {
    const auto slot = size_t(std::find(names.begin(), names.end(), e.properties[i].name) - names.begin());
    if (slot == k_slots || e.properties[i].list || found[slot]) continue;
    slots[i] = int(slot);
    found[slot] = true;
  }
  for (int s = 0; s < 3; ++s) {
    if (!found[s]) {
      throw Error({source.where().file, e.line},
                  fmt::format("element \"vertex\" has no property {}, add it", quote(names[size_t(s)])));
    }
  }
  const bool normals = found[3] && found[4] && found[5], texcoords = found[6] && found[7];
  mesh.positions.resize(e.count);
  if (normals) mesh.normals.resize(e.count);
  if (texcoords) mesh.texcoords.resize(e.count);
  for (uint64_t i = 0; i < e.count; ++i) {
    source.begin_record(e, i);
    float values[k_slots] = {};
    for (size_t k = 0; k < slots.size(); ++k) {
      if (slots[k] == k_skipped) {
        skip(source, e.properties[k]);
      } else {
        values[slots[k]] = float(source.value(e.properties[k].type));
      }
    }
    source.end_record();
    const Vec3 p(values[0], values[1], values[2]);
    if (!(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z))) {
      throw Error(source.where(), fmt::format("vertex {} is not finite ({} {} {}), mend the mesh", i, p.x, p.y, p.z));
    }
    mesh.positions[i] = p;
    if (normals) mesh.normals[i] = {values[3], values[4], values[5]};
    if (texcoords) mesh.texcoords[i] = {values[6], values[7]};
  }
}

struct Polygon {
  size_t first, count;  // triangles
};

// Returns the polygons that were read before the vertices, and so are to be ended later.
template <class Source>
std::vector<Polygon> read_faces(Source& source, const Element& e, uint64_t vertex_count, RawMesh& raw,
                                const WarningSink& warning) {
  size_t indices = e.properties.size();
  for (size_t k = 0; k < e.properties.size(); ++k) {
    const Property& p = e.properties[k];
    if (p.list && (p.name == "vertex_indices" || p.name == "vertex_index")) indices = k;
  }
  if (indices == e.properties.size()) {
    throw Error({source.where().file, e.line}, "element \"face\" has no list vertex_indices, add it");
  }
  const bool has_texcoords = std::any_of(e.properties.begin(), e.properties.end(),
                                         [](const Property& p) { return p.list && p.name == "texcoord"; });
  if (has_texcoords) {
    warn(warning, {source.where().file, e.line},
         "texture coordinates of faces are ignored; export the mesh with those of vertices (s t or u v)");
  }
  std::vector<Polygon> early;
  std::vector<UVec3>& triangles = raw.mesh.triangles;
  triangles.reserve(e.count);
  for (uint64_t i = 0; i < e.count; ++i) {
    source.begin_record(e, i);
    for (size_t k = 0; k < e.properties.size(); ++k) {
      const Property& p = e.properties[k];
      if (k != indices) {
        skip(source, p);
        continue;
      }
      const uint64_t corners = read_count(source, p);
      uint32_t first = 0, previous = 0;
      for (uint64_t c = 0; c < corners; ++c) {
        const double index = source.value(p.type);
        if (!(index >= 0.0 && index < double(vertex_count) && index == std::floor(index))) {
          throw Error(source.where(),
                      fmt::format("face {} refers to vertex {}, but there are {} vertices, counted from 0", i, index,
                                  vertex_count));
        }
        const uint32_t v = uint32_t(index);
        if (c == 0) first = v;
        if (c >= 2) triangles.push_back({first, previous, v});
        previous = v;
      }
      if (corners < 3) {
        ++raw.short_polygons;
        continue;
      }
      const Polygon polygon{triangles.size() - size_t(corners - 2), size_t(corners - 2)};
      if (raw.mesh.positions.empty()) {
        if (corners > 3) early.push_back(polygon);
      } else {
        raw.end_polygon(polygon.first, polygon.count);
      }
    }
    source.end_record();
  }
  return early;
}

template <class Source>
RawMesh read_body(Source source, const Header& header, const std::string& path, const WarningSink& warning) {
  const Element* vertex = header.find("vertex");
  const Element* face = header.find("face");
  if (!vertex) throw Error({path}, "the PLY header has no element \"vertex\", nothing to render");
  if (!face) throw Error({path}, "the PLY header has no element \"face\", export the mesh with its faces");
  if (vertex->count > k_max_vertices) throw Error({path, vertex->line}, "too many vertices for 32-bit indices");
  RawMesh raw;
  std::vector<Polygon> early;
  for (const Element& e : header.elements) {
    if (e.properties.empty() && (&e != vertex || e.count == 0)) continue;
    check_room(source, e);
    if (&e == vertex) {
      read_vertices(source, e, raw.mesh);
    } else if (&e == face) {
      early = read_faces(source, e, vertex->count, raw, warning);
    } else {
      for (uint64_t i = 0; i < e.count; ++i) {
        source.begin_record(e, i);
        for (const Property& p : e.properties) skip(source, p);
        source.end_record();
      }
    }
  }
  for (const Polygon& polygon : early) raw.end_polygon(polygon.first, polygon.count);
  source.finish(warning);
  return raw;
}

}  // namespace

RawMesh read_ply(const std::string& path, std::string_view bytes, const WarningSink& warning) {
  const Header header = HeaderParser(path, bytes).parse();
  const std::string_view body = bytes.substr(header.body);
  if (header.format == Format::ascii) {
    return read_body(AsciiSource(path, body, header.body_line), header, path, warning);
  }
  const bool little = header.format == Format::little_endian;
  return little == (std::endian::native == std::endian::little)
             ? read_body(BinarySource<false>(path, body), header, path, warning)
             : read_body(BinarySource<true>(path, body), header, path, warning);
}

}  // namespace fieldtrace::mesh_readers
