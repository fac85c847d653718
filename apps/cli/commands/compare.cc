// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "apps/calibration_input.h"
#include "apps/commands.h"
#include "apps/image_module.h"
#include "apps/observations.h"
#include "apps/report/results.h"
#include "calib/calibration_file.h"
#include "calib/check.h"
#include "calib/compare.h"
#include "calib/error.h"
#include "calib/output_folder.h"
#include "calib/result_files.h"
#include "calib/text_file.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 3> kRowNames{"top", "middle", "bottom"};
constexpr std::array<std::string_view, 3> kColumnNames{"left", "centre", "right"};

std::string DistanceText(double distance) {
  return std::isfinite(distance) ? fmt::format("{:g} m", distance) : "far away";
}

std::string PartText(size_t part) {
  return part == 4 ? "centre" : fmt::format("{} {}", kRowNames[part / 3], kColumnNames[part % 3]);
}

std::string Verdict(const CameraDifference& camera) {
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
             camera.name,
             a.model->name,
             b.model->name,
             a.image_size[0],
             a.image_size[1]);
  if (a.model == b.model) PrintParameters(a, b);
  const Eigen::Vector3d turn = LogRotation(camera.T_b_a.R) * 180 / std::numbers::pi;
  const Eigen::Vector3d shift = 1e3 * camera.T_b_a.t;
  fmt::print(
      "  taken out: a turn by ({:.4f}, {:.4f}, {:.4f}) degrees and a shift by ({:.3f}, "
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
  fmt::print("  {}\n", Verdict(camera));
}

// correlations.csv beside a calibration.yaml, or none when it does not belong to it.
Correlations CorrelationsBeside(const CalibrationFile& calibration) {
  const std::filesystem::path path = calibration.path.parent_path() / "correlations.csv";
  if (!std::filesystem::exists(path)) return {};
  Correlations correlations = ReadCorrelations(ReadTextFile(path), path.string());
  constexpr double kSame = 1e-6;  // of correlations that stand in both files
  for (const CalibratedCamera& camera : calibration.cameras) {
    const Eigen::VectorXd sigma = camera.covariance.diagonal().cwiseSqrt();
    std::vector<std::pair<Eigen::Index, Eigen::Index>> places;  // here and in the table
    for (size_t k = 0; k < camera.params.size(); ++k) {
      const std::string name = fmt::format("{}.{}", camera.name, camera.model->params[k].name);
      const auto found = std::ranges::find(correlations.names, name);
      const auto here = static_cast<Eigen::Index>(k);
      if (found == correlations.names.end() || !std::isfinite(sigma[here])) continue;
      places.emplace_back(here, found - correlations.names.begin());
    }
    for (const auto& [i, row] : places) {
      for (const auto& [j, column] : places) {
        const double expected = camera.covariance(i, j);
        const double found = correlations.matrix(row, column) * sigma[i] * sigma[j];
        if (std::abs(found - expected) > kSame * sigma[i] * sigma[j]) return {};
      }
    }
  }
  return correlations;
}

void PrintMount(const MountDifference& mount, bool has_correlations) {
  const auto degrees = [](double angle) { return angle * 180 / std::numbers::pi; };
  fmt::print(
      "  on the rig: turned by {:.4f} degrees (sigmas: {:.4f}), shifted by {:.3f} mm "
      "(sigmas: {:.3f}{}){}\n",
      degrees(mount.turn),
      degrees(mount.turn_sigma),
      1e3 * mount.shift,
      1e3 * mount.shift_sigma,
      has_correlations
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
                        camera.name,
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
  return DrawFieldMapsByModule(maps, largest);
}

struct Comparison {
  std::vector<CalibratedCamera> a;  ///< the cameras that both calibrations have
  std::vector<CalibratedCamera> b;
  std::vector<CameraDifference> differences;
  std::vector<MountDifference> mounts;  ///< of all cameras but the first
  bool has_correlations = true;         ///< between cameras, of both
};

Comparison CompareAll(const std::vector<CalibratedCamera>& a,
                      const Correlations& of_a,
                      const CalibrationFile& b,
                      const std::vector<double>& distances) {
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
                fmt::format("{}: has no camera of the other calibration, whose first is '{}'",
                            b.path.string(),
                            a.front().name));
  }
  const auto counterparts = [&](size_t c) {
    return Counterparts{comparison.a[c], comparison.b[c], comparison.differences[c]};
  };
  const Correlations of_b = CorrelationsBeside(b);
  // What is exact has none.
  const auto exact = [](const std::vector<CalibratedCamera>& cameras) {
    return std::ranges::all_of(cameras, [](const CalibratedCamera& camera) {
      return camera.covariance.isZero(0) && camera.sigma_xi.isZero(0);
    });
  };
  comparison.has_correlations =
      (!of_a.names.empty() || exact(a)) && (!of_b.names.empty() || exact(b.cameras));
  for (size_t c = 1; c < comparison.a.size(); ++c) {
    comparison.mounts.push_back(CompareMounts(counterparts(0), counterparts(c), of_a, of_b));
  }
  return comparison;
}

// Names of cameras that are not among `others`.
std::string NamesWithout(const std::vector<CalibratedCamera>& cameras,
                         const std::vector<CalibratedCamera>& others) {
  std::string names;
  for (const CalibratedCamera& camera : cameras) {
    if (std::ranges::find(others, camera.name, &CalibratedCamera::name) != others.end()) continue;
    names += (names.empty() ? "" : ", ") + camera.name;
  }
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
                       {"mount_turn", camera.mount_turn},
                       {"mount_shift", camera.mount_shift},
                       {"mount_probability", camera.mount_probability}});
  }
  return {{"valid", check.valid}, {"frames", check.frames}, {"cameras", cameras}};
}

void PrintCheck(const CalibrationCheck& check) {
  for (const CameraCheck& camera : check.cameras) {
    fmt::print(
        "{}: {} points in {} frames\n"
        "  RMS with only poses free {:.4f} px; expected of a calibration that holds {:.4f}; with "
        "parameters of the new images' own {:.4f}\n"
        "  probability of so large a gap by chance: {:.2g}\n",
        camera.name,
        camera.points,
        check.frames,
        camera.rms_held,
        camera.expected,
        camera.rms_free,
        camera.probability);
    if (&camera != &check.cameras.front()) {
      fmt::print(
          "  on the rig turned by {:.4f} degrees and shifted by {:.3f} mm: probability {:.2g}\n",
          camera.mount_turn * 180 / std::numbers::pi,
          1e3 * camera.mount_shift,
          camera.mount_probability);
    }
    fmt::print("  {}\n\n", camera.valid ? "still valid" : "NOT VALID any more");
  }
}

void Check(const CompareCommand& command,
           const CalibrationFile& old,
           const std::vector<double>& distances,
           const ConsoleOptions& options) {
  const Session session = ReadSession(command.session, CameraModels());
  const Target target = ReadTarget(session.target);
  Console console(options.quiet);
  std::optional<OutputFolder> out;
  if (!command.out.empty()) {
    RefuseToReplaceInputs(session, command.out, {"compare.csv", "check.json", "difference.png"});
    out.emplace(command.out);
  }
  StageStore store = out ? OpenStageStore(command.out, session, false)
                         : StageStore({}, {}, false);  // keeps nothing
  const SessionObservations observations =
      CollectObservations(session, target, options, {&store, nullptr}, &console);
  const CalibrationCheck check =
      CheckCalibration(old,
                       MakeCalibrationInput(session, target, observations.cameras, &console),
                       {.threads = options.threads, .progress = [&](const std::string& stage) {
                          console.Progress(stage);
                          return !Interrupted();
                        }});
  if (out) {
    std::vector<CalibratedCamera> fresh;
    for (size_t c = 0; c < check.cameras.size(); ++c) fresh.push_back(CameraOf(check.fresh, c));
    const Comparison comparison = CompareAll(fresh, CorrelationsOf(check.fresh), old, distances);
    out->Write("check.json", CheckJson(check).dump(2) + "\n");
    out->Write("compare.csv", TableCsv(comparison.differences));
    out->Write("difference.png", Picture(comparison.differences, comparison.a));
    out->Commit();
  }
  if (command.json) {
    fmt::print("{}\n", CheckJson(check).dump(2));
  } else {
    PrintCheck(check);
    fmt::print(
        "{}\n",
        check.valid ? "the calibration is still valid" : "the calibration is not valid any more");
  }
  if (!check.valid) {
    std::fflush(stdout);
    throw Error(ErrorKind::kJob,
                fmt::format("{} does not hold for the images of {} any more; calibrate again",
                            old.path.string(),
                            session.path.string()));
  }
}

}  // namespace

void RunCompare(const CompareCommand& command, const ConsoleOptions& options) {
  if (command.b.empty() == command.session.empty()) {
    throw Error(ErrorKind::kInput,
                "give either a second calibration.yaml or --check session.yaml; see 'plenocal "
                "compare --help'");
  }
  if (command.json && command.session.empty()) {
    throw Error(ErrorKind::kInput,
                "--json goes with --check; of two calibrations -o OUT writes compare.csv");
  }
  std::vector<double> distances = command.distances;
  if (distances.empty()) distances = {1, std::numeric_limits<double>::infinity()};
  for (const double distance : distances) {
    if (!(distance > 0)) {
      throw Error(
          ErrorKind::kInput,
          fmt::format("--distance {}: expected a positive number of metres, or inf", distance));
    }
  }
  const CalibrationFile a = ReadCalibration(command.a, CameraModels());
  if (!command.session.empty()) {
    Check(command, a, distances, options);
    return;
  }
  const CalibrationFile b = ReadCalibration(command.b, CameraModels());
  std::optional<OutputFolder> out;
  if (!command.out.empty()) out.emplace(command.out);
  const Comparison comparison = CompareAll(a.cameras, CorrelationsBeside(a), b, distances);
  for (size_t c = 0; c < comparison.a.size(); ++c) {
    PrintCamera(comparison.differences[c], comparison.a[c], comparison.b[c]);
    if (c > 0) PrintMount(comparison.mounts[c - 1], comparison.has_correlations);
    fmt::print("\n");
  }
  if (out) {
    out->Write("compare.csv", TableCsv(comparison.differences));
    out->Write("difference.png", Picture(comparison.differences, comparison.a));
    out->Commit();
  }
  for (const auto& [own, others] : {std::pair(&a, &comparison.a), std::pair(&b, &comparison.b)}) {
    const std::string names = NamesWithout(own->cameras, *others);
    if (!names.empty()) fmt::print("not compared, only in {}: {}\n", own->path.string(), names);
  }
  const bool judged =
      std::ranges::all_of(comparison.differences, &CameraDifference::has_prediction) &&
      std::ranges::all_of(comparison.mounts, &MountDifference::has_prediction);
  const bool same = std::ranges::all_of(comparison.differences, &CameraDifference::same) &&
                    std::ranges::none_of(comparison.mounts, &MountDifference::differs);
  fmt::print("{}\n",
             !judged ? "no verdict for all cameras"
                     : (same ? "same within uncertainty" : "not the same within uncertainty"));
  if (out) fmt::print("\nwritten to {}\n", command.out.string());
}

}  // namespace plenocal
