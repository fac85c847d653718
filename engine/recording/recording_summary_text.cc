// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "calib/base/json_text.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "engine/recording/recording_summary.h"

namespace plenocal {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kShownGaps = 3, kShownImages = 3;  // of each kind; --json has all
constexpr double kMillisecond = 1e-3;               // s

/// "  times      ...": a line of the summary.
std::string Line(std::string_view what, const std::string& text) {
  return fmt::format("  {:<12}{}\n", what, text);
}

std::string CameraLines(const Recording& recording) {
  std::string text;
  for (const RecordedCamera& camera : recording.cameras) {
    std::string line = fmt::format("{}: {}, {} px",
                                   camera.name,
                                   Counted(camera.images.size(), "image"),
                                   fmt::join(camera.image_size, " x "));
    if (camera.bayer) line += fmt::format(", mosaic {}", BayerName(*camera.bayer));
    if (!camera.white_images.empty()) {
      line += ", " + Counted(camera.white_images.size(), "white image");
    }
    if (camera.markers) line += ", supplied markers";
    text += Line(text.empty() ? "cameras" : "", line);
  }
  return text;
}

/// Topics of a recording of messages: those with images, then the others.
std::string TopicLines(const Recording& recording) {
  std::string text;
  for (const ImageTopic& topic : recording.topics) {
    std::string line = fmt::format("{}: {}", topic.name, Counted(topic.count, "image"));
    if (topic.defect.empty()) {
      line += fmt::format(", {}, {} px", topic.encoding, fmt::join(topic.size, " x "));
    }
    if (topic.rate > 0) line += fmt::format(", {:.4g} a second", topic.rate);
    if (!topic.camera.empty()) line += ", camera " + topic.camera;
    if (!topic.camera_info.empty()) line += ", intrinsics in " + topic.camera_info;
    if (!topic.defect.empty()) line += ", not used: " + topic.defect;
    text += Line(text.empty() ? "topics" : "", line);
  }
  for (const MessageTopic& topic : recording.other_topics) {
    const std::string line = fmt::format(
        "{}: no images, {} of {}", topic.name, Counted(topic.count, "message"), topic.type);
    text += Line(text.empty() ? "topics" : "", line);
  }
  return text;
}

std::string NoteLines(const Recording& recording) {
  std::string text;
  for (const std::string& note : recording.notes) text += Line(text.empty() ? "notes" : "", note);
  return text;
}

std::string PairingText(const Recording& recording) {
  if (recording.paired_by == Pairing::By::kName) return "paired by name";
  return fmt::format("paired by time, at most {:.3g} ms apart", recording.tolerance / kMillisecond);
}

std::string FrameText(const Recording& recording, const RecordingSummary& summary) {
  return recording.cameras.size() == 1 ? fmt::format("{}", recording.frames.size())
                                       : fmt::format("{}, {} with images of all cameras ({})",
                                                     recording.frames.size(),
                                                     summary.complete,
                                                     PairingText(recording));
}

std::string TimeLine(const Recording& recording, const RecordingSummary& summary) {
  if (!recording.HasTimes()) return Line("times", "none: the order is that of the names");
  return Line("times", fmt::format("{:.3f} s, {:.4g} frames/s", summary.duration, summary.rate));
}

std::string PairLines(const Recording& recording, const RecordingSummary& summary) {
  std::string text;
  for (const PairSummary& pair : summary.pairs) {
    std::string line = fmt::format(
        "{} and {}: {}", recording.cameras[0].name, pair.camera, Counted(pair.frames, "frame"));
    if (recording.HasTimes() && pair.frames > 0) {
      line += fmt::format(", times differ by {:.3g} ms (median), at most {:.3g} ms",
                          pair.median / kMillisecond,
                          pair.largest / kMillisecond);
    }
    text += Line(text.empty() ? "pairs" : "", line);
  }
  return text;
}

std::string GapsText(const std::vector<Gap>& gaps) {
  std::vector<std::string> texts;
  for (size_t i = 0; i < std::min(kShownGaps, gaps.size()); ++i) {
    texts.push_back(fmt::format("{} after {}", gaps[i].missing, gaps[i].after));
  }
  if (gaps.size() > kShownGaps) {
    texts.push_back(fmt::format("{} more gaps", gaps.size() - kShownGaps));
  }
  return fmt::format("{}", fmt::join(texts, ", "));
}

std::string MissingLines(const RecordingSummary& summary) {
  std::string text;
  for (const CameraSummary& camera : summary.cameras) {
    std::string line = camera.name + ": ";
    if (!camera.gaps) {
      line += "not known, as there are neither times nor numbers";
    } else if (camera.gaps->empty()) {
      line += "none, no interval is larger than usual";
    } else {
      line += fmt::format("{} ({})", Counted(camera.Missing(), "image"), GapsText(*camera.gaps));
    }
    text += Line(text.empty() ? "missing" : "", line);
  }
  return text;
}

std::string ExposureLines(const Recording& recording, const RecordingSummary& summary) {
  std::string text;
  for (size_t c = 0; c < recording.cameras.size(); ++c) {
    const auto& exposure = summary.cameras[c].exposure;
    if (!exposure) continue;
    std::string line = fmt::format("{}: {:.4g} to {:.4g} ms, {}",
                                   recording.cameras[c].name,
                                   exposure->least,
                                   exposure->largest,
                                   Counted(exposure->changes, "change"));
    if (exposure->changes > 0) {
      line += fmt::format(", the largest by a factor of {:.3g}", exposure->largest_step);
    }
    if (const size_t filled = recording.cameras[c].exposures_filled; filled > 0) {
      line += fmt::format("; not given for {}, where it is the mean of the neighbours'",
                          Counted(filled, "image"));
    }
    text += Line(text.empty() ? "exposure" : "", line);
  }
  return text;
}

/// Grouped by reason, as many images can have the same.
std::string LeftOutLines(const Recording& recording) {
  std::map<std::string, std::vector<std::string>> by_reason;
  for (const LeftOut& left : recording.left_out) {
    by_reason[fmt::format("{}: {}", left.camera, left.reason)].push_back(left.where);
  }
  std::string text;
  for (auto& [reason, where] : by_reason) {
    const size_t count = where.size();
    where.resize(std::min(count, kShownImages));
    if (count > kShownImages) where.emplace_back("...");
    text +=
        Line(text.empty() ? "left out" : "",
             fmt::format("{}, {} ({})", Counted(count, "image"), reason, fmt::join(where, ", ")));
  }
  return text;
}

std::string FileLines(const Recording& recording) {
  std::string text;
  const auto add = [&](const char* what, const std::filesystem::path& path) {
    if (!path.empty()) text += Line(what, path.string());
  };
  add("calibration", recording.calibration);
  for (const ForeignCalibration& foreign : recording.foreign) {
    text += Line("calibration",
                 fmt::format("{}, {}",
                             foreign.path.string(),
                             foreign.format.empty() ? "a form that is not read"
                                                    : "of the format " + foreign.format));
  }
  add("truth", recording.truth);
  for (const RecordedCamera& camera : recording.cameras) {
    add("response", camera.response);
    add("vignetting", camera.vignetting);
  }
  return text;
}

std::string NeedLines(const RecordingSummary& summary) {
  std::string text = "\nmissing for\n";
  for (const CommandNeeds& needs : summary.needs) {
    text += Line(needs.command,
                 needs.lacks.empty() ? "nothing" : fmt::format("{}", fmt::join(needs.lacks, "; ")));
  }
  return text;
}

Json ToJson(const RecordedCamera& camera, const CameraSummary& summary) {
  Json json{{"images", camera.images.size()}, {"image_size", camera.image_size}};
  if (camera.bayer) json["bayer"] = BayerName(*camera.bayer);
  json["white_images"] = camera.white_images.size();
  if (summary.gaps) {
    json["missing"] = summary.Missing();
    json["gaps"] = Json::array();
    for (const Gap& gap : *summary.gaps) {
      json["gaps"].push_back({{"after", gap.after}, {"missing", gap.missing}});
    }
  }
  if (summary.exposure) {
    json["exposure"] = {{"least", summary.exposure->least},
                        {"largest", summary.exposure->largest},
                        {"changes", summary.exposure->changes},
                        {"largest_step", summary.exposure->largest_step},
                        {"filled", camera.exposures_filled}};
  }
  return json;
}

}  // namespace

std::string SummaryText(const Recording& recording, const RecordingSummary& summary) {
  const std::string text =
      fmt::format("{} ({})\n", recording.path.string(), recording.layout) + TopicLines(recording) +
      CameraLines(recording) + Line("frames", FrameText(recording, summary)) +
      TimeLine(recording, summary) + PairLines(recording, summary) + MissingLines(summary) +
      ExposureLines(recording, summary) + LeftOutLines(recording) + NoteLines(recording) +
      FileLines(recording) + NeedLines(summary);
  return Escaped(text, "\n");
}

std::string SummaryJson(const Recording& recording, const RecordingSummary& summary) {
  Json json{{"path", recording.path.string()}, {"layout", recording.layout}};
  for (size_t c = 0; c < recording.cameras.size(); ++c) {
    json["cameras"][recording.cameras[c].name] = ToJson(recording.cameras[c], summary.cameras[c]);
  }
  for (const ImageTopic& topic : recording.topics) {
    json["topics"][topic.name] = {{"type", topic.type},
                                  {"count", topic.count},
                                  {"encoding", topic.encoding},
                                  {"image_size", topic.size},
                                  {"rate", topic.rate},
                                  {"camera", topic.camera},
                                  {"camera_info", topic.camera_info},
                                  {"defect", topic.defect}};
  }
  for (const MessageTopic& topic : recording.other_topics) {
    json["topics"][topic.name] = {{"type", topic.type}, {"count", topic.count}};
  }
  json["notes"] = recording.notes;
  json["frames"] = recording.frames.size();
  json["complete"] = summary.complete;
  json["paired_by"] = recording.paired_by == Pairing::By::kName ? "name" : "time";
  if (recording.HasTimes()) {
    json["duration"] = summary.duration;
    json["rate"] = summary.rate;
  }
  for (const PairSummary& pair : summary.pairs) {
    Json& entry = json["pairs"][pair.camera] = {{"frames", pair.frames}};
    if (!recording.HasTimes()) continue;
    entry["median"] = pair.median;
    entry["largest"] = pair.largest;
  }
  json["left_out"] = Json::array();
  for (const LeftOut& left : recording.left_out) {
    json["left_out"].push_back(
        {{"camera", left.camera}, {"image", left.where}, {"reason", left.reason}});
  }
  for (const CommandNeeds& needs : summary.needs) json["lacks"][needs.command] = needs.lacks;
  return JsonText(json) + '\n';
}

}  // namespace plenocal
