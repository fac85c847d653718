// SPDX-License-Identifier: Apache-2.0
#include "assess/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "apps/charts/field_map.h"
#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/evaluate/compare_truths.h"
#include "apps/photometry/attenuation_compare.h"
#include "apps/report/verdict_json.h"
#include "assess/check.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/estimate/describe.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/output_folder.h"
#include "engine/observe/session_observations.h"
#include "engine/session/calibration_input.h"
#include "engine/session/open_session.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// Two calibrations of the same cameras, or one calibration and new images.
struct CompareArguments {
  std::filesystem::path a, b;     ///< calibration.yaml; `b` is empty when there are new images
  std::filesystem::path session;  ///< session.yaml of the new images; empty: none
  std::vector<double> distances;  ///< m; empty: 1 m and infinity
  std::filesystem::path out;      ///< folder for picture and table; empty: neither
  std::vector<std::string> map;   ///< NAME=NAME: cameras of other names
  bool json = false;              ///< new images: JSON on standard output
};

/// A calibration and its correlations between cameras; these are empty where no file has them.
struct Correlated {
  CalibrationRecord record;
  Correlations correlations;
};

constexpr std::array<std::string_view, 3> kRowNames{"top", "middle", "bottom"};
constexpr std::array<std::string_view, 3> kColumnNames{"left", "centre", "right"};

std::string DistanceText(double distance) {
  return std::isfinite(distance) ? fmt::format("{:g} m", distance) : "far away";
}

std::string PartText(size_t part) {
  return part == 4 ? "centre" : fmt::format("{} {}", kRowNames[part / 3], kColumnNames[part % 3]);
}

std::string VerdictText(const CameraDifference& camera) {
  if (!camera.has_prediction) {
    return "no verdict: a file has no sigmas, or a parameter that is not determined";
  }
  if (camera.same) return "same within uncertainty";
  std::string places;
  for (const DistanceDifference& at : camera.distances) {
    std::string parts;
    for (size_t p = 0; p < at.parts.size(); ++p) {
      if (at.parts[p].differs) parts += (parts.empty() ? "" : ", ") + PartText(p);
    }
    if (!parts.empty()) {
      places +=
          fmt::format("{}{}: {}", places.empty() ? "" : "; ", DistanceText(at.distance), parts);
    }
  }
  return fmt::format("they differ by more than their sigmas explain at {}", places);
}

// Of cameras of one model; images may agree where parameters that hang together do not.
void PrintParameters(const CalibratedCamera& a, const CalibratedCamera& b) {
  fmt::print("  {:<10} {:>16} {:>16} {:>14} {:>10}\n", "parameter", "A", "B", "A - B", "in sigmas");
  for (size_t i = 0; i < a.params.size(); ++i) {
    if (a.model->params[i].prior_sigma > 0) continue;  // too many to read
    const auto k = static_cast<Eigen::Index>(i);
    const double difference = a.params[i] - b.params[i];
    const double sigma = std::sqrt(a.covariance(k, k) + b.covariance(k, k));
    fmt::print("  {:<10} {:>16.9g} {:>16.9g} {:>14.3g} {:>10}\n",
               a.model->params[i].name,
               a.params[i],
               b.params[i],
               difference,
               sigma > 0 ? fmt::format("{:.1f}", difference / sigma) : "");
  }
}

void PrintCamera(const CameraDifference& camera,
                 const CalibratedCamera& a,
                 const CalibratedCamera& b) {
  fmt::print("{}  ({} and {}, {} x {} px)\n",
             Styled(Stream::kOut, Style::kHeading, camera.name),
             a.model->name,
             b.model->name,
             a.image_size[0],
             a.image_size[1]);
  if (a.model == b.model) PrintParameters(a, b);
  const Eigen::Vector3d turn = LogRotation(camera.T_b_a.R) * 180 / std::numbers::pi;
  const Eigen::Vector3d shift = 1e3 * camera.T_b_a.t;
  fmt::print(
      "  taken out: a rotation vector ({:.4f}, {:.4f}, {:.4f}) degrees and a translation ({:.3f}, "
      "{:.3f}, {:.3f}) mm of the camera's frame\n",
      turn.x(),
      turn.y(),
      turn.z(),
      shift.x(),
      shift.y(),
      shift.z());
  fmt::print("  {:<10} {:<14} {:>10} {:>10} {:>12} {:>8}\n",
             "distance",
             "part",
             "RMS px",
             "max px",
             "sigmas' px",
             "pixels");
  for (const DistanceDifference& at : camera.distances) {
    const auto line = [&](const std::string& part, const ImageDifference& difference) {
      fmt::print("  {:<10} {:<14} {:>10.4f} {:>10.4f} {:>12} {:>8}{}\n",
                 DistanceText(at.distance),
                 part,
                 difference.rms,
                 difference.largest,
                 camera.has_prediction ? fmt::format("{:.4f}", difference.predicted) : "unknown",
                 difference.points,
                 difference.differs ? "  differs" : "");
    };
    line("all", at.all);
    for (size_t p = 0; p < at.parts.size(); ++p) line(PartText(p), at.parts[p]);
  }
  fmt::print("  {}\n", VerdictText(camera));
}

Correlated ReadCorrelated(const std::filesystem::path& path) {
  Correlated calibration{ReadCalibration(path, CameraModels()), {}};
  calibration.correlations = ReadCorrelationsBeside(calibration.record);
  return calibration;
}

// Gives a camera another name, in the correlations too.
void Rename(const std::string& from, const std::string& to, Correlated* calibration) {
  const auto camera = std::ranges::find(calibration->record.cameras, from, &CalibratedCamera::name);
  camera->name = to;
  for (std::string& name : calibration->correlations.names) {
    if (name.starts_with(from + ".")) name.replace(0, from.size(), to);
  }
}

// Gives cameras of `calibration` the names of their counterparts in `others`, as `--map` states:
// OTHER=OWN.
void ApplyMap(const std::vector<std::string>& map,
              const std::vector<std::string>& others,
              Correlated* calibration) {
  std::vector<std::string> own;
  for (const CalibratedCamera& camera : calibration->record.cameras) own.push_back(camera.name);
  const auto require = [](const std::string& entry,
                          const std::string& name,
                          const std::vector<std::string>& names) {
    if (std::ranges::find(names, name) != names.end()) return;
    const std::vector<std::string_view> known(names.begin(), names.end());
    throw Error(ErrorKind::kInput,
                fmt::format("--map {}: no camera '{}'{}", entry, name, SuggestName(name, known)));
  };
  std::map<std::string, std::string> renamed;  // own name -> new one
  for (const std::string& entry : map) {
    const size_t equals = entry.find('=');
    if (equals == std::string::npos) {
      throw Error(ErrorKind::kInput,
                  fmt::format("--map {}: expected NAME=NAME, a camera of the first file and its "
                              "counterpart",
                              entry));
    }
    const std::string other = entry.substr(0, equals), name = entry.substr(equals + 1);
    require(entry, other, others);
    require(entry, name, own);
    if (!renamed.emplace(name, other).second) {
      throw Error(ErrorKind::kInput, fmt::format("--map {}: '{}' stands twice", entry, name));
    }
  }
  for (const auto& [name, other] : renamed) {
    if (std::ranges::find(own, other) == own.end() || renamed.contains(other)) continue;
    throw Error(ErrorKind::kInput,
                fmt::format("--map {}={}: {} has a camera '{}' already; map that one too",
                            other,
                            name,
                            calibration->record.path.string(),
                            other));
  }
  // By way of names that no camera has, since names may be exchanged.
  for (const auto& [name, other] : renamed) Rename(name, "=" + other, calibration);
  for (const auto& [name, other] : renamed) Rename("=" + other, other, calibration);
}

// "; name counterparts by --map left=cam0,right=cam1" for cameras without equal names.
std::string MapSuggestion(const std::vector<std::string>& a, const std::vector<std::string>& b) {
  std::vector<std::string> pairs;
  for (size_t c = 0; c < std::min(a.size(), b.size()); ++c) {
    pairs.push_back(fmt::format("{}={}", a[c], b[c]));
  }
  return fmt::format("name counterparts by --map, for instance --map {}", fmt::join(pairs, ","));
}

std::vector<std::string> CameraNames(const std::vector<CalibratedCamera>& cameras) {
  std::vector<std::string> names;
  for (const CalibratedCamera& camera : cameras) names.push_back(camera.name);
  return names;
}

/// The cameras that two calibrations have in common, and their differences.
struct Comparison {
  std::vector<CalibratedCamera> a;  ///< the cameras that both calibrations have
  std::vector<CalibratedCamera> b;
  std::vector<CameraDifference> differences;
  std::vector<ExtrinsicsDifference> mounts;  ///< of all cameras but the first
  bool has_correlations = true;              ///< between cameras, of both
};

void PrintExtrinsics(const ExtrinsicsDifference& mount, const Comparison& comparison) {
  const auto degrees = [](double angle) { return angle * 180 / std::numbers::pi; };
  fmt::print(
      "  on the rig: turned by {:.4f} degrees (sigmas: {:.4f}), shifted by {:.3f} mm (sigmas: "
      "{:.3f}{}){}\n",
      degrees(mount.rotation),
      degrees(mount.rotation_sigma),
      1e3 * mount.translation,
      1e3 * mount.translation_sigma,
      comparison.has_correlations
          ? ""
          : "; too large, without the correlations of a correlations.csv beside each file",
      mount.differs ? ": more than the sigmas explain" : "");
}

// The table as a file.
std::string TableCsv(const std::vector<CameraDifference>& differences) {
  std::string text = "camera,distance,part,rms,largest,predicted,probability,pixels,differs\n";
  for (const CameraDifference& camera : differences) {
    for (const DistanceDifference& at : camera.distances) {
      const auto line = [&](const std::string& part, const ImageDifference& difference) {
        text +=
            fmt::format("{},{:g},{},{:.6g},{:.6g},{},{},{},{}\n",
                        CsvCell(camera.name),
                        at.distance,
                        part,
                        difference.rms,
                        difference.largest,
                        camera.has_prediction ? fmt::format("{:.6g}", difference.predicted) : "",
                        camera.has_prediction ? fmt::format("{:.3g}", difference.probability) : "",
                        difference.points,
                        difference.differs ? 1 : 0);
      };
      line("all", at.all);
      for (size_t p = 0; p < at.parts.size(); ++p) line(PartText(p), at.parts[p]);
    }
  }
  return text;
}

// The differences over the images.
std::string Picture(const std::vector<CameraDifference>& differences,
                    const std::vector<CalibratedCamera>& cameras) {
  std::vector<FieldMap> maps;
  double largest = 0;
  for (size_t i = 0; i < differences.size(); ++i) {
    for (const DistanceDifference& at : differences[i].distances) {
      FieldMap map{
          fmt::format(
              "{}, {}: RMS {:.3g} px", differences[i].name, DistanceText(at.distance), at.all.rms),
          cameras[i].image_size,
          kComparedColumns,
          kComparedRows,
          {}};
      for (const PixelDifference& pixel : at.pixels) {
        map.Put(pixel.u_px.x(), pixel.u_px.y(), {pixel.difference_px.x(), pixel.difference_px.y()});
      }
      largest = std::max(largest, at.all.largest);
      maps.push_back(std::move(map));
    }
  }
  return DrawFieldMaps(maps, largest);
}

Comparison CompareAll(const std::vector<CalibratedCamera>& a,
                      const Correlations& of_a,
                      const Correlated& of_b,
                      const std::vector<double>& distances) {
  const CalibrationRecord& b = of_b.record;
  Comparison comparison;
  for (const CalibratedCamera& camera : a) {
    // Single cameras are compared whatever they are called.
    const bool single = a.size() == 1 && b.cameras.size() == 1;
    const auto other = std::ranges::find_if(b.cameras, [&](const CalibratedCamera& each) {
      return single || each.name == camera.name;
    });
    if (other == b.cameras.end()) continue;
    comparison.a.push_back(camera);
    comparison.b.push_back(*other);
    comparison.differences.push_back(CompareCameras(camera, *other, distances));
  }
  if (comparison.a.empty()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{}: has no camera of the other calibration; {}",
                            b.path.string(),
                            MapSuggestion(CameraNames(a), CameraNames(b.cameras))));
  }
  const auto counterparts = [&](size_t c) {
    return Counterparts{comparison.a[c], comparison.b[c], comparison.differences[c]};
  };
  // An exact calibration has no correlations.
  const auto exact = [](const std::vector<CalibratedCamera>& cameras) {
    return std::ranges::all_of(cameras, [](const CalibratedCamera& camera) {
      return camera.covariance.isZero(0) && camera.sigma_xi.isZero(0);
    });
  };
  comparison.has_correlations =
      (!of_a.names.empty() || exact(a)) && (!of_b.correlations.names.empty() || exact(b.cameras));
  for (size_t c = 1; c < comparison.a.size(); ++c) {
    comparison.mounts.push_back(
        CompareExtrinsics(counterparts(0), counterparts(c), of_a, of_b.correlations));
  }
  return comparison;
}

// Names of cameras that are not among `others`.
std::vector<std::string> NamesWithout(const std::vector<CalibratedCamera>& cameras,
                                      const std::vector<CalibratedCamera>& others) {
  std::vector<std::string> names = CameraNames(cameras);
  std::erase_if(names, [&](const std::string& name) {
    return std::ranges::find(others, name, &CalibratedCamera::name) != others.end();
  });
  return names;
}

nlohmann::json CheckJson(const CalibrationCheck& check) {
  nlohmann::json cameras = nlohmann::json::array();
  for (const CameraCheck& camera : check.cameras) {
    cameras.push_back({{"name", camera.name},
                       {"valid", camera.valid},
                       {"points", camera.points},
                       {"rms_poses_only", camera.rms_held},
                       {"rms_expected", camera.expected},
                       {"rms_all_free", camera.rms_free},
                       {"probability", camera.probability},
                       {"mount_turn", camera.rotation},
                       {"mount_shift", camera.translation},
                       {"mount_probability", camera.extrinsics_probability}});
  }
  return {{"valid", check.valid},
          {"frames", check.frames},
          {"verdict", VerdictJson(JudgeCheck(check))},
          {"cameras", cameras}};
}

void PrintCheck(const CalibrationCheck& check) {
  for (const CameraCheck& camera : check.cameras) {
    fmt::print(
        "{}: {} in {}; RMS with only poses free {:.4f} px; expected of a calibration that "
        "holds {:.4f}\n",
        camera.name,
        Counted(static_cast<size_t>(camera.points), "point"),
        Counted(static_cast<size_t>(check.frames), "frame"),
        camera.rms_held,
        camera.expected);
  }
  const Verdict verdict = JudgeCheck(check);
  for (const Finding& finding : verdict.findings) {
    fmt::print("{}{}\n",
               finding.grade == Grade::kGood
                   ? std::string()
                   : fmt::format("{} [{}] ", GradeName(finding.grade), finding.code),
               finding.what);
    if (!finding.remedy.empty()) fmt::print("    {}\n", finding.remedy);
  }
  fmt::print("verdict: {}. {}\n",
             GradeName(verdict.grade),
             check.valid
                 ? Styled(Stream::kOut, Style::kGood, "the calibration is still valid")
                 : Styled(Stream::kOut, Style::kError, "the calibration is not valid any more"));
}

/// Paths in it may be no UTF-8.
std::string CheckText(const CalibrationCheck& check) {
  return CheckJson(check).dump(2, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// Writes compare.csv and difference.png.
void WriteComparison(const Comparison& comparison, OutputFolder* out) {
  out->Write("compare.csv", TableCsv(comparison.differences));
  out->Write("difference.png", Picture(comparison.differences, comparison.a));
}

/// The verdict on a calibration with new images; throws `Error` when it does not hold any more.
void ReportCheck(const CompareArguments& arguments, const CalibrationCheck& check) {
  if (arguments.json) {
    fmt::print("{}\n", CheckText(check));
  } else {
    PrintCheck(check);
  }
  if (check.valid) return;
  std::fflush(stdout);
  throw Error(ErrorKind::kJob,
              fmt::format("{} does not hold for the images of {} any more; calibrate again",
                          arguments.a.string(),
                          arguments.session.string()));
}

void CheckWithNewImages(const CompareArguments& arguments,
                        const std::vector<double>& distances,
                        const ConsoleOptions& shared) {
  Correlated old = ReadCorrelated(arguments.a);
  const Session session = OpenSession(arguments.session);
  if (!arguments.map.empty()) {
    std::vector<std::string> names;
    for (const SessionCamera& camera : session.cameras) names.push_back(camera.name);
    ApplyMap(arguments.map, names, &old);
  }
  RefuseSeveralTargets(session, "compare --check");
  if (session.scene) {
    throw Error(ErrorKind::kInput,
                fmt::format("{0}: has a scene in place of a target, and no poses without a "
                            "calibration of its own; calibrate it, then compare both: plenocal "
                            "calibrate {0} -o NEW; plenocal compare {1} NEW/calibration.yaml",
                            arguments.session.string(),
                            arguments.a.string()));
  }
  const Target target = ReadTarget(session.target);
  Console console(shared);
  std::optional<OutputFolder> out;
  if (!arguments.out.empty()) {
    out.emplace(arguments.out);
    out->RefuseInputs({"compare.csv", "check.json", "difference.png"});
  }
  DetectionCache cache = out ? OpenDetectionCache(arguments.out, session, EarlierDetections::kReuse)
                             : DetectionCache({}, {}, false);  // keeps nothing
  const Run run = console.NewRun();
  const SessionObservations observations =
      CollectObservations(session, target, run, {&cache, nullptr});
  const CalibrationCheck check =
      CheckCalibration(old.record,
                       MakeCalibrationInput(session, target, observations.cameras, run),
                       {.threads = shared.threads,
                        .progress = [&](const std::string& stage) { return run.Progress(stage); }});
  if (out) {
    std::vector<CalibratedCamera> fresh;
    for (size_t c = 0; c < check.cameras.size(); ++c)
      fresh.push_back(DescribeCamera(check.fresh, c));
    out->Write("check.json", CheckText(check) + "\n");
    WriteComparison(CompareAll(fresh, DescribeCorrelations(check.fresh), old, distances), &*out);
    out->Commit();
  }
  ReportCheck(arguments, check);
}

void PrintComparison(const Comparison& comparison) {
  for (size_t c = 0; c < comparison.a.size(); ++c) {
    PrintCamera(comparison.differences[c], comparison.a[c], comparison.b[c]);
    if (c > 0) PrintExtrinsics(comparison.mounts[c - 1], comparison);
    fmt::print("\n");
  }
}

std::string VerdictText(const Comparison& comparison) {
  const bool judged =
      std::ranges::all_of(comparison.differences, &CameraDifference::has_prediction) &&
      std::ranges::all_of(comparison.mounts, &ExtrinsicsDifference::has_prediction);
  if (!judged) return "no verdict for all cameras";
  const bool same = std::ranges::all_of(comparison.differences, &CameraDifference::same) &&
                    std::ranges::none_of(comparison.mounts, &ExtrinsicsDifference::differs);
  return same ? "same within uncertainty" : "not the same within uncertainty";
}

// The cameras that only one of the calibrations has, and how to compare them all the same.
void PrintLeftOver(const Comparison& comparison,
                   const CalibrationRecord& a,
                   const CalibrationRecord& b) {
  const std::vector<std::string> of_a = NamesWithout(a.cameras, comparison.a),
                                 of_b = NamesWithout(b.cameras, comparison.b);
  for (const auto& [calibration, names] : {std::pair(&a, &of_a), std::pair(&b, &of_b)}) {
    if (names->empty()) continue;
    fmt::print(
        "not compared, only in {}: {}\n", calibration->path.string(), fmt::join(*names, ", "));
  }
  if (!of_a.empty() && !of_b.empty()) fmt::print("  {}\n", MapSuggestion(of_a, of_b));
}

void CompareCalibrations(const CompareArguments& arguments, const std::vector<double>& distances) {
  const Correlated a = ReadCorrelated(arguments.a);
  Correlated b = ReadCorrelated(arguments.b);
  ApplyMap(arguments.map, CameraNames(a.record.cameras), &b);
  std::optional<OutputFolder> out;
  if (!arguments.out.empty()) out.emplace(arguments.out);
  const Comparison comparison = CompareAll(a.record.cameras, a.correlations, b, distances);
  PrintComparison(comparison);
  if (out) {
    WriteComparison(comparison, &*out);
    out->Commit();
  }
  PrintLeftOver(comparison, a.record, b.record);
  fmt::print("{}\n", VerdictText(comparison));
  if (out) fmt::print("\nwritten to {}\n", arguments.out.string());
}

void CheckArguments(const CompareArguments& arguments) {
  if (arguments.b.empty() == arguments.session.empty()) {
    throw Error(
        ErrorKind::kInput,
        "give either a second calibration.yaml or --check session.yaml; see 'plenocal compare --help'");
  }
  if (arguments.json && arguments.session.empty()) {
    throw Error(ErrorKind::kInput,
                "--json goes with --check; of two calibrations -o OUT writes compare.csv");
  }
  for (const double distance : arguments.distances) {
    if (distance > 0) continue;
    throw Error(
        ErrorKind::kInput,
        fmt::format("--distance {}: expected a positive number of metres, or inf", distance));
  }
}

bool IsTiff(const std::filesystem::path& path) {
  return path.extension() == ".tiff" || path.extension() == ".tif";
}

/// Two attenuation images.
void CompareVignetting(const CompareArguments& arguments) {
  if (!IsTiff(arguments.b) || !arguments.map.empty() || !arguments.distances.empty()) {
    throw Error(ErrorKind::kInput,
                "attenuations are compared with each other: give two TIFF files and -o only");
  }
  std::optional<OutputFolder> out;
  if (!arguments.out.empty()) out.emplace(arguments.out);
  const Attenuation a = ReadAttenuationWithSigma(arguments.a),
                    b = ReadAttenuationWithSigma(arguments.b);
  if (a.values.size() != b.values.size()) {
    throw Error(ErrorKind::kInput,
                fmt::format("{} is {} x {} pixels, {} is {} x {}; they must be of one camera",
                            arguments.a.string(),
                            a.values.cols,
                            a.values.rows,
                            arguments.b.string(),
                            b.values.cols,
                            b.values.rows));
  }
  const AttenuationComparison comparison = CompareAttenuations(a, b);
  fmt::print("{}", ComparisonText(comparison, arguments.a.string(), arguments.b.string()));
  if (!out) return;
  out->Write("vignetting_compare.csv", ComparisonCsv(comparison));
  out->Write("report.html", ComparisonPage(comparison, arguments.a.string(), arguments.b.string()));
  out->Commit();
  fmt::print("written to {}\n", arguments.out.string());
}

/// Two files of `groundtruth`.
void CompareGroundTruths(const CompareArguments& arguments) {
  if (arguments.b.empty() || !IsGroundTruth(arguments.b) || !arguments.map.empty() ||
      !arguments.distances.empty()) {
    throw Error(
        ErrorKind::kInput,
        "ground truths are compared with each other: give two groundtruth.yaml and -o only");
  }
  std::optional<OutputFolder> out;
  if (!arguments.out.empty()) out.emplace(arguments.out);
  const TruthComparison comparison = CompareTruths(arguments.a, arguments.b);
  fmt::print("{}", ComparisonText(comparison, arguments.a.string(), arguments.b.string()));
  if (!out) return;
  out->Write("groundtruth_compare.csv", ComparisonCsv(comparison));
  out->Commit();
  fmt::print("written to {}\n", arguments.out.string());
}

void RunCompare(const CompareArguments& arguments, const ConsoleOptions& shared) {
  CheckArguments(arguments);
  if (IsTiff(arguments.a)) {
    CompareVignetting(arguments);
    return;
  }
  if (IsGroundTruth(arguments.a)) {
    CompareGroundTruths(arguments);
    return;
  }
  std::vector<double> distances = arguments.distances;
  if (distances.empty()) distances = {1, std::numeric_limits<double>::infinity()};
  if (arguments.session.empty()) {
    CompareCalibrations(arguments, distances);
  } else {
    CheckWithNewImages(arguments, distances, shared);
  }
}

constexpr const char* kCompareHelp =
    "How far two calibrations differ in the image, beside the difference that their sigmas predict.\n"
    "\n"
    "  plenocal compare A/calibration.yaml B/calibration.yaml\n"
    "  plenocal compare A/calibration.yaml --check session.yaml\n"
    "  plenocal compare A/vignetting_left.tiff B/vignetting_left.tiff\n"
    "  plenocal compare A/groundtruth.yaml B/groundtruth.yaml\n"
    "\n"
    "The rotation and translation of the camera frames that the difference of the intrinsics implies is removed first.";

RunCommand DeclareCompare(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<CompareArguments>();
  app->add_option("a", arguments->a, "calibration.yaml, an attenuation (TIFF), or groundtruth.yaml")
      ->required();
  app->add_option("b", arguments->b, "another, of any models");
  app->add_option(
      "--check",
      arguments->session,
      "instead of another: session.yaml with new images of the same cameras. Does the calibration still hold for them (only poses free)? Exit status 1: no");
  app->add_option(
      "-o,--out",
      arguments->out,
      "folder for difference.png and compare.csv; of attenuations vignetting_compare.csv and a page, of ground truths groundtruth_compare.csv");
  app->add_option(
         "--map",
         arguments->map,
         "cameras of other names, separated by commas: left=cam0,right=cam1 for 'left' of the first file, or of the new images, that is 'cam0' in the other")
      ->delimiter(',');
  app->add_flag("--json", arguments->json, "with --check: JSON on standard output");
  AddThreads(app, shared);
  // Not FLOAT, which must be finite.
  app->add_option(
         "--distance", arguments->distances, "distances of the scene, m, or inf (default: 1 inf)")
      ->type_name("METRES");
  AddQuiet(app, shared);
  return [arguments, shared] { RunCompare(*arguments, *shared); };
}

}  // namespace

Command CompareCommand() { return {"compare", kCompareHelp, DeclareCompare}; }

}  // namespace plenocal
