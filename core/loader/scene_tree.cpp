#include "core/loader/scene_tree.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <fstream>

#include <pugixml.hpp>

#include "core/io/input_file.h"

namespace fieldtrace {
namespace {

namespace fs = std::filesystem;

// Deeper than any sensible scene; keeps the recursive builders from overflowing the stack.
constexpr int k_max_depth = 64;
// Bounds the exponential growth of parameters that contain one another.
constexpr size_t k_max_value_length = size_t(1) << 20;
// Bound the exponential growth of repeated includes. A scene of a million instances takes a fifth of these bytes.
constexpr int k_max_scene_files = 10000;
constexpr uint64_t k_max_scene_bytes = uint64_t(1) << 30;

// Elements that may appear, with their permitted attributes.
struct KnownTag {
  const char* tag;
  const char* attributes;
  bool has_children = false;
};
constexpr KnownTag k_known_tags[] = {
    {"scene", " version type id name ", true},
    {"integrator", " type id name version ", true},
    {"sensor", " type id name version ", true},
    {"film", " type id name version ", true},
    {"rfilter", " type id name version ", true},
    {"sampler", " type id name version ", true},
    {"shape", " type id name version ", true},
    {"emitter", " type id name version ", true},
    {"bsdf", " type id name version ", true},
    {"texture", " type id name version ", true},
    {"medium", " type id name version ", true},
    {"phase", " type id name version ", true},
    {"volume", " type id name version ", true},
    {"spectrum", " type id name version value filename ", true},
    {"rgb", " name value "},
    {"float", " name value "},
    {"integer", " name value "},
    {"boolean", " name value "},
    {"string", " name value "},
    {"point", " name value x y z "},
    {"vector", " name value x y z "},
    {"ref", " id name "},
    {"transform", " name ", true},
    {"translate", " value x y z "},
    {"scale", " value x y z "},
    {"rotate", " value x y z angle "},
    {"matrix", " value "},
    {"lookat", " origin target up "},
    {"default", " name value "},
    {"include", " filename name "},
    {"path", " value "},
    {"alias", " id as "},
};

const KnownTag* find_tag(const std::string& tag) {
  for (const KnownTag& known : k_known_tags)
    if (tag == known.tag) return &known;
  return nullptr;
}

// Throws Error if the XML declaration names another encoding.
void require_utf8(const std::string& text, const std::string& file) {
  const size_t begin = text.find("<?xml"), end = text.find("?>");
  if (begin > 3 || end == std::string::npos) return;  // behind a byte order mark at most
  std::string declaration = text.substr(begin, end - begin);
  std::transform(declaration.begin(), declaration.end(), declaration.begin(),
                 [](unsigned char c) { return char(std::tolower(c)); });
  if (declaration.find("encoding") == std::string::npos || declaration.find("utf-8") != std::string::npos) return;
  if (declaration.find("ascii") != std::string::npos) return;
  throw Error({file, 1}, "declares another encoding than UTF-8; save it as UTF-8");
}

struct Alias {
  std::string id, as;
  SourceLocation where;
};

struct Parameter {
  std::string value;
  bool used = false;
};

struct File {
  std::string name;
  std::vector<size_t> line_starts;
  std::shared_ptr<SearchFolders> folders;

  SourceLocation at(ptrdiff_t offset) const {
    if (offset < 0) return {name, 0};
    const auto next = std::upper_bound(line_starts.begin(), line_starts.end(), size_t(offset));
    return {name, int(next - line_starts.begin())};
  }
};

class TreeReader {
 public:
  TreeReader(const std::map<std::string, std::string>& parameters, const Diagnostics& diagnostics)
      : diagnostics_(diagnostics) {
    for (const auto& [name, value] : parameters) parameters_[name] = {value, false};
  }

  void read(const std::string& path, SceneTree& tree) {
    std::vector<SceneNode> roots;
    read_file(path, {}, SearchFolders(), 0, roots, true);
    tree.root = std::move(roots.front());
    tree.files = files_;
    register_ids(tree.root, tree);
    for (const Alias& alias : aliases_) {
      const auto found = tree.ids.find(alias.id);
      if (found == tree.ids.end()) throw Error(alias.where, "no object has the id '" + alias.id + "'");
      if (!tree.ids.emplace(alias.as, found->second).second)
        throw Error(alias.where, "the id '" + alias.as + "' is taken; choose another name for the alias");
    }
    for (const auto& [name, parameter] : parameters_)
      if (!parameter.used)
        diagnostics_.unknown({path, 0}, "the parameter '" + name + "' is not used by the scene; check its spelling");
  }

 private:
  // Appends the file's root element to `out`, or its children for an included scene (not `keep_scene`).
  void read_file(const fs::path& path, const SourceLocation& from, const SearchFolders& outer, int depth,
                 std::vector<SceneNode>& out, bool keep_scene) {
    std::error_code ignored;
    const fs::path canonical = fs::weakly_canonical(path, ignored);
    if (std::find(open_files_.begin(), open_files_.end(), canonical) != open_files_.end())
      throw Error(from, "'" + path.string() + "' includes itself; remove the cycle");

    const std::string text = read_text(path, from);
    files_.push_back(path.string());

    File file;
    file.name = path.string();
    file.line_starts = {0};
    for (size_t i = 0; i < text.size(); ++i)
      if (text[i] == '\n') file.line_starts.push_back(i + 1);
    file.folders = std::make_shared<SearchFolders>(outer);
    file.folders->insert(file.folders->begin(), path.parent_path());

    // As it is: the parser counts bytes of what it has converted.
    pugi::xml_document document;
    const pugi::xml_parse_result result =
        document.load_buffer(text.data(), text.size(), pugi::parse_default, pugi::encoding_utf8);
    if (!result) throw Error(file.at(result.offset), std::string("is not well-formed XML: ") + result.description());
    const pugi::xml_node root = document.document_element();
    if (!root) throw Error({file.name, 1}, "holds no element; a scene file starts with <scene version=\"3.0.0\">");
    const SourceLocation where = file.at(root.offset_debug());
    for (pugi::xml_node other = root.next_sibling(); other; other = other.next_sibling()) {
      if (other.type() != pugi::node_element) continue;
      throw Error(file.at(other.offset_debug()),
                  std::string("<") + other.name() + "> follows the file's only element; keep one of them");
    }
    if (keep_scene && std::strcmp(root.name(), "scene") != 0)
      throw Error(where, std::string("starts with <") + root.name() + ">, not <scene>; give a scene file");
    check_version(root, where);

    open_files_.push_back(canonical);
    if (!keep_scene && std::strcmp(root.name(), "scene") == 0)
      for (const pugi::xml_node child : root.children()) read_element(child, file, depth, out);
    else
      read_element(root, file, depth, out);
    open_files_.pop_back();
    if (keep_scene && out.empty()) throw Error(where, "the root element cannot be read");
  }

  // The contents of a scene file referenced at `from`, which is empty for the main file.
  std::string read_text(const fs::path& path, const SourceLocation& from) {
    const SourceLocation where = from.file.empty() ? SourceLocation{path.string(), 0} : from;
    if (is_special_file(path.string())) {
      throw Error(where, (from.file.empty() ? "" : "'" + path.string() + "' ") + k_special_file_message);
    }
    std::error_code failed;
    const uint64_t bytes = fs::file_size(path, failed);
    if (!failed) bytes_read_ += bytes;
    if (++files_read_ > k_max_scene_files) {
      throw Error(where, "the scene includes more than " + std::to_string(k_max_scene_files) +
                             " files; include fewer, or each of them fewer times");
    }
    if (bytes_read_ > k_max_scene_bytes) {
      throw Error(where, "the scene's files have more than " + std::to_string(k_max_scene_bytes >> 20) +
                             " MiB with this one; keep meshes in .ply files, and include each file fewer times");
    }
    std::string text(failed ? 0 : size_t(bytes), '\0');
    std::ifstream stream(path, std::ios::binary);
    if (text.empty() || !stream.read(text.data(), std::streamsize(text.size())))
      throw Error(where, (from.file.empty() ? "" : "'" + path.string() + "' ") +
                             "cannot be read, or is empty; check the path and its permissions");
    if (text.substr(0, 4).find('\0') != std::string::npos)
      throw Error({path.string(), 0}, "is not in UTF-8, but in UTF-16 or another encoding; save it as UTF-8");
    require_utf8(text, path.string());
    return text;
  }

  void check_version(const pugi::xml_node& root, const SourceLocation& where) {
    const pugi::xml_attribute version = root.attribute("version");
    if (!version) throw Error(where, std::string("<") + root.name() + "> lacks its version; write version=\"3.0.0\"");
    const char* text = version.value();
    if (!std::isdigit(static_cast<unsigned char>(*text)))
      throw Error(where, std::string("version '") + text + "' is not of the form 3.0.0");
    if (text[0] < '2' && !std::isdigit(static_cast<unsigned char>(text[1])))
      diagnostics_.unknown(where,
                           std::string("version '") + text +
                               "' is older than 2.0.0; names are read as in 3.0.0, so camelCase ones are unknown");
  }

  void read_element(const pugi::xml_node& xml, const File& file, int depth, std::vector<SceneNode>& out) {
    if (xml.type() != pugi::node_element) return;
    const SourceLocation where = file.at(xml.offset_debug());
    if (depth > k_max_depth)
      throw Error(where, "elements are nested more than " + std::to_string(k_max_depth) + " deep; flatten the scene");
    const KnownTag* known = find_tag(xml.name());
    if (!known) {
      diagnostics_.unknown(where, std::string("unknown element <") + xml.name() + ">, ignored");
      return;
    }

    SceneNode node;
    node.tag = xml.name();
    node.where = where;
    node.folders = file.folders;
    for (const pugi::xml_attribute& attribute : xml.attributes()) {
      const std::string key = attribute.name();
      if (node.attribute(key)) throw Error(where, "<" + node.tag + "> has the attribute '" + key + "' twice");
      if (!std::strstr(known->attributes, (" " + key + " ").c_str())) {
        diagnostics_.unknown(where, "unknown attribute '" + key + "' of <" + node.tag + ">, ignored");
        continue;
      }
      node.attributes.emplace_back(key, substitute(attribute.value(), where));
    }
    if (const std::string* value = node.attribute("type")) node.type = *value;
    if (const std::string* value = node.attribute("id")) node.id = *value;
    if (const std::string* value = node.attribute("name")) node.name = *value;

    if (node.tag == "default") {
      if (node.name.empty()) throw Error(where, "<default> needs a name");
      parameters_.emplace(node.name, Parameter{node.required("value"), true});
    } else if (node.tag == "include") {
      const std::string path = resolve_file(node, node.required("filename"));
      const size_t first = out.size();
      read_file(path, where, *file.folders, depth + 1, out, false);
      if (!node.name.empty() && out.size() == first + 1) out.back().name = node.name;
    } else if (node.tag == "path") {
      file.folders->insert(file.folders->begin(), resolve_file(node, node.required("value")));
    } else if (node.tag == "alias") {
      aliases_.push_back({node.required("id"), node.required("as"), where});
    } else {
      for (const pugi::xml_node child : xml.children()) read_element(child, file, depth + 1, node.children);
      if (!known->has_children) drop_children(node);
      out.push_back(std::move(node));
    }
  }

  void drop_children(SceneNode& node) const {
    for (const SceneNode& child : node.children)
      diagnostics_.unknown(child.where, "<" + child.tag + "> has no meaning inside <" + node.tag + ">, ignored");
    node.children.clear();
  }

  // Replaces every `$name` by the longest parameter name that matches; `\$` is a literal dollar.
  std::string substitute(const std::string& text, const SourceLocation& where) {
    std::string result;
    for (size_t i = 0; i < text.size();) {
      if (text[i] == '\\' && i + 1 < text.size() && text[i + 1] == '$') {
        result += '$';
        i += 2;
      } else if (text[i] == '$') {
        size_t end = i + 1;
        const auto longest = longest_parameter(text, i + 1);
        if (longest == parameters_.end()) {
          while (end < text.size() && (std::isalnum(static_cast<unsigned char>(text[end])) || text[end] == '_')) ++end;
          const std::string name = text.substr(i + 1, end - i - 1);
          throw Error(where, "undefined parameter $" + name + "; give it by -D " + name + "=... or a <default> above");
        }
        longest->second.used = true;
        result += longest->second.value;
        i += 1 + longest->first.size();
      } else {
        result += text[i++];
      }
      if (result.size() > k_max_value_length) throw Error(where, "a value grows beyond 1 MiB; check its parameters");
    }
    return result;
  }

  std::map<std::string, Parameter>::iterator longest_parameter(const std::string& text, size_t begin) {
    auto best = parameters_.end();
    for (auto it = parameters_.begin(); it != parameters_.end(); ++it)
      if (!it->first.empty() && text.compare(begin, it->first.size(), it->first) == 0 &&
          (best == parameters_.end() || it->first.size() > best->first.size()))
        best = it;
    return best;
  }

  static void register_ids(const SceneNode& node, SceneTree& tree) {
    if (!node.id.empty() && node.tag != "ref") {
      const auto [found, inserted] = tree.ids.emplace(node.id, &node);
      if (!inserted) {
        const SourceLocation& first = found->second->where;
        throw Error(node.where, "the id '" + node.id + "' is already given in line " + std::to_string(first.line) +
                                    " of " + first.file + "; ids must differ");
      }
    }
    for (const SceneNode& child : node.children) register_ids(child, tree);
  }

  const Diagnostics& diagnostics_;
  std::map<std::string, Parameter> parameters_;
  std::vector<Alias> aliases_;
  std::vector<fs::path> open_files_;
  std::vector<std::string> files_;
  int files_read_ = 0;
  uint64_t bytes_read_ = 0;
};

}  // namespace

const std::string* SceneNode::attribute(const std::string& key) const {
  for (const auto& [name_, value] : attributes)
    if (name_ == key) return &value;
  return nullptr;
}

const std::string& SceneNode::required(const std::string& key) const {
  const std::string* value = attribute(key);
  if (!value) throw Error(where, "<" + tag + "> lacks its attribute '" + key + "'");
  return *value;
}

void load_scene_tree(const std::string& path, const std::map<std::string, std::string>& parameters,
                     const Diagnostics& diagnostics, SceneTree& tree) {
  TreeReader(parameters, diagnostics).read(path, tree);
}

std::string resolve_file(const SceneNode& node, const std::string& name) {
  std::error_code ignored;
  if (name.find('\0') == std::string::npos && !name.empty()) {
    const fs::path given(name);
    if (given.is_absolute()) {
      if (fs::exists(given, ignored)) return name;
    } else {
      for (const fs::path& folder : *node.folders)
        if (fs::exists(folder / given, ignored)) return (folder / given).string();
    }
  }
  throw Error(node.where, "the file '" + name + "' does not exist; it is looked for beside the scene file");
}

}  // namespace fieldtrace
