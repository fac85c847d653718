// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/left_out.h"

#include <fmt/format.h>

#include <cctype>
#include <map>
#include <set>
#include <utility>

#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"

namespace plenocal {
namespace {

// "corner 12: hidden" and "corner 7: hidden" have one.
std::string WithoutNumbers(const std::string& reason) {
  std::string text;
  for (const char c : reason) {
    const bool digit = std::isdigit(static_cast<unsigned char>(c)) != 0;
    if (digit && !text.empty() && text.back() == '#') continue;
    text += digit ? '#' : c;
  }
  return text;
}

// Always in quotation marks, since most of these texts need them.
std::string Quoted(const std::string& reason) {
  std::string text = Escaped(reason);
  for (size_t at = 0; (at = text.find('"', at)) != std::string::npos; at += 2)
    text.insert(at, 1, '"');
  return '"' + text + '"';
}

}  // namespace

std::vector<std::string> GroupedByReason(const std::vector<LeftOut>& items) {
  std::vector<std::vector<const LeftOut*>> groups;  // in the order of their first items
  std::map<std::pair<bool, std::string>, size_t> group_of;
  for (const LeftOut& item : items) {
    const auto [place, is_new] =
        group_of.emplace(std::pair(item.whole, WithoutNumbers(item.reason)), groups.size());
    if (is_new) groups.emplace_back();
    groups[place->second].push_back(&item);
  }
  std::vector<std::string> lines;
  for (const auto& group : groups) {
    const LeftOut& first = *group.front();
    if (group.size() == 1) {
      lines.push_back(fmt::format("left out {}: {}", first.where, first.reason));
      continue;
    }
    std::set<std::string> images;
    for (const LeftOut* item : group)
      images.insert(item->frame.empty() ? item->where : item->frame);
    const std::string count = first.whole ? Counted(group.size(), "image")
                                          : fmt::format("{} in {}",
                                                        Counted(group.size(), "time"),
                                                        Counted(images.size(), "image"));
    lines.push_back(fmt::format("left out {}, the first {}: {}", count, first.where, first.reason));
  }
  return lines;
}

void ReportLeftOut(const std::vector<LeftOut>& items, const Run& run) {
  for (const LeftOut& item : items) {
    run.Message(fmt::format("  left out {}: {}", item.where, item.reason));
  }
}

std::string LeftOutCsv(const std::vector<LeftOut>& items) {
  std::string csv = "camera,frame,marker,where,reason\n";
  for (const LeftOut& item : items) {
    csv += fmt::format("{},{},{},{},{}\n",
                       CsvCell(item.camera),
                       CsvCell(item.frame),
                       item.marker,
                       Quoted(item.where),
                       Quoted(item.reason));
  }
  return csv;
}

}  // namespace plenocal
