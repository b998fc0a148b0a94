#include "tools/report/html.h"

#include <fmt/format.h>

namespace fieldtrace {
namespace {

constexpr const char* k_style = R"(
body{font:15px/1.45 sans-serif;max-width:1180px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:1em 0}
td,th{border:1px solid #ccc;padding:3px 8px;text-align:right}
th{background:#f2f2f2}
td{white-space:nowrap}
td.l,th.l{text-align:left;white-space:normal}
.t{color:#777}
.w{overflow-x:auto}
figure{display:inline-block;margin:0 8px 12px 0}
figcaption{font-size:13px;color:#555}
code{overflow-wrap:anywhere}
.g{display:flex;flex-wrap:wrap}
.g figure{flex:1 1 300px;max-width:640px}
svg,img{max-width:100%;height:auto}
)";

}  // namespace

std::string html_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c;
  }
  return out;
}

std::string html_page(const std::string& title, const std::string& body, const std::string& style) {
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{}</title>\n"
      "<style>{}{}</style></head>\n<body>\n{}</body></html>\n",
      html_text(title), k_style, style, body);
}

std::string html_table(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows,
                       size_t left) {
  const auto line = [&](const std::vector<std::string>& cells, const char* tag) {
    std::string html = "<tr>";
    for (size_t i = 0; i < cells.size(); ++i) {
      html += fmt::format("<{0}{1}>{2}</{0}>", tag, i < left ? " class=\"l\"" : "", cells[i]);
    }
    return html + "</tr>\n";
  };
  std::string html = "<div class=\"w\"><table>\n" + line(head, "th");
  for (const std::vector<std::string>& row : rows) html += line(row, "td");
  return html + "</table></div>\n";
}

std::string html_figure(const std::string& uri, const std::string& caption) {
  if (uri.empty()) return "";
  const std::string text = html_text(caption);
  return fmt::format("<figure><img src=\"{0}\" alt=\"{1}\"><figcaption>{1}</figcaption></figure>\n", uri, text);
}

}  // namespace fieldtrace
