// Pieces of HTML pages that stand alone: they refer to nothing outside themselves and run no scripts.
//
// Thread-safety: pure functions.
#pragma once

#include <string>
#include <vector>

namespace fieldtrace {

// Escapes & < > " as entities.
std::string html_text(const std::string& text);

// A whole page. `title` is text, `body` HTML, `style` CSS that follows the common one. Fits narrow screens.
std::string html_page(const std::string& title, const std::string& body, const std::string& style = {});

// A table that scrolls by itself where the screen is narrower. Cells are HTML; the first `left` columns are set left,
// the others right. Rows may be shorter than the head.
std::string html_table(const std::vector<std::string>& head, const std::vector<std::vector<std::string>>& rows,
                       size_t left = 1);

// A picture with its caption, which is text and the alternative text, too. "" if `uri` is empty.
std::string html_figure(const std::string& uri, const std::string& caption);

}  // namespace fieldtrace
