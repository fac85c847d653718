// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/merge.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "apps/cli/program.h"
#include "assess/verdict.h"
#include "calib/base/error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "calib/io/yaml.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

struct MergeArguments {
  std::vector<fs::path> calibrations;
  std::vector<std::string> moved;  ///< cameras that moved on the rig between them
  fs::path out;
};

std::vector<CalibrationRecord> ReadAll(const MergeArguments& arguments) {
  std::vector<CalibrationRecord> records;
  for (const fs::path& argument : arguments.calibrations) {
    const fs::path path = fs::is_directory(argument) ? argument / "calibration.yaml" : argument;
    records.push_back(ReadWithCorrelations(path));
  }
  return records;
}

// Paths after the keys `from` of the session that a calibration states as its own.
std::vector<fs::path> EarlierFilesOf(const CalibrationRecord& record) {
  std::string text, session, folder;
  for (const auto& [key, value] : record.provenance) {
    if (key == "session_text") text = value;
    if (key == "session") session = value;
    if (key == "folder") folder = value;
  }
  if (text.empty()) return {};
  const YamlNode root = YamlNode::Parse(text, record.path.string() + ": session_text");
  std::vector<fs::path> files;
  const auto add = [&](const YamlNode& node) {
    if (!node.Has("from")) return;
    const YamlNode from = node.At("from");
    const std::string file = from.IsMap() ? from.At("file").AsString() : from.AsString();
    files.push_back(fs::path(folder) / fs::path(session).parent_path() / file);
  };
  add(root);
  if (root.Has("cameras")) {
    for (const auto& [name, camera] : root.At("cameras").Entries()) add(camera);
  }
  return files;
}

bool IsSameFile(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error) && !error;
}

// What stands in two calibrations would count twice.
void RefuseRepeated(const std::vector<CalibrationRecord>& records) {
  for (size_t i = 0; i < records.size(); ++i) {
    for (size_t j = 0; j < records.size(); ++j) {
      if (j < i && IsSameFile(records[i].path, records[j].path)) {
        throw Error(ErrorKind::kInput, records[i].path.string() + ": is given twice");
      }
      for (const fs::path& earlier : EarlierFilesOf(records[i])) {
        if (i == j || !IsSameFile(earlier, records[j].path)) continue;
        throw Error(ErrorKind::kInput,
                    fmt::format("{0}: was calibrated from {1}, which it contains already; leave "
                                "{1} out",
                                records[i].path.string(),
                                records[j].path.string()));
      }
    }
  }
}

// The micro lenses and the attenuation of each camera, those of the last calibration that has them.
void CopyCameraFiles(const std::vector<CalibrationRecord>& records,
                     CalibrationRecord* merged,
                     OutputFolder* out) {
  for (CalibratedCamera& camera : merged->cameras) {
    for (const auto member : {&CalibratedCamera::micro_lenses, &CalibratedCamera::vignetting}) {
      fs::path file;
      for (const CalibrationRecord& record : records) {
        for (const CalibratedCamera& other : record.cameras) {
          if (other.name != camera.name || (other.*member).empty()) continue;
          file = record.path.parent_path() / (other.*member);
        }
      }
      if (file.empty()) continue;
      camera.*member = file.filename().string();
      out->Write(camera.*member, ReadInput(file, InputLimit::kTable));
    }
  }
}

std::string MergeCsv(const MergedCalibrations& merged, const std::vector<std::string>& names) {
  std::string text = "calibration,unknown,deviation,sigma,in_sigmas\n";
  for (const MergeDeviation& deviation : merged.deviations) {
    text += fmt::format("{},{},{:.9g},",
                        CsvCell(names[deviation.calibration]),
                        CsvCell(NameOfDeviation(merged, deviation)),
                        deviation.deviation);
    text +=
        deviation.sigma > 0
            ? fmt::format("{:.6g},{:.3f}\n", deviation.sigma, deviation.deviation / deviation.sigma)
            : ",\n";
  }
  return text;
}

std::string PlaceText(const RigidTransform& T_camera_rig, const Vector6d& sigma_xi) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const Vector6d xi = Log(T_camera_rig);
  return fmt::format(
      "xi = ({:.3f}, {:.3f}, {:.3f}) +- ({:.3f}, {:.3f}, {:.3f}) mm, "
      "({:.4f}, {:.4f}, {:.4f}) +- ({:.4f}, {:.4f}, {:.4f}) degrees",
      1e3 * xi[0],
      1e3 * xi[1],
      1e3 * xi[2],
      1e3 * sigma_xi[0],
      1e3 * sigma_xi[1],
      1e3 * sigma_xi[2],
      kDegrees * xi[3],
      kDegrees * xi[4],
      kDegrees * xi[5],
      kDegrees * sigma_xi[3],
      kDegrees * sigma_xi[4],
      kDegrees * sigma_xi[5]);
}

std::string CameraText(const CalibratedCamera& camera) {
  std::string text = fmt::format("{}  ({}, {} x {} px)\n",
                                 camera.name,
                                 camera.model->name,
                                 camera.image_size[0],
                                 camera.image_size[1]);
  for (size_t k = 0; k < camera.params.size(); ++k) {
    if (camera.model->params[k].prior_sigma > 0) continue;  // too many to read
    text += fmt::format("  {:<10} {:>16.9g} +- {:.2g}\n",
                        camera.model->params[k].name,
                        camera.params[k],
                        camera.Sigma(k));
  }
  if (!(camera.sigma_xi.array() > 0).any()) return text;
  return text + fmt::format("  on the rig: {}\n", PlaceText(camera.T_camera_rig, camera.sigma_xi));
}

// The places of cameras that moved.
std::string MountsText(const MergedCalibrations& merged, const std::vector<std::string>& names) {
  std::string text;
  for (const MergedMount& mount : merged.mounts) {
    text += fmt::format("{} on the rig in {}: {}\n",
                        merged.record.cameras[mount.camera].name,
                        names[mount.calibration],
                        PlaceText(mount.T_camera_rig, mount.sigma_xi));
  }
  return text;
}

std::string MountsCsv(const MergedCalibrations& merged, const std::vector<std::string>& names) {
  std::string text =
      "calibration,camera,x,y,z,w_x,w_y,w_z,sigma_x,sigma_y,sigma_z,sigma_w_x,sigma_w_y,sigma_w_z\n";
  for (const MergedMount& mount : merged.mounts) {
    const Vector6d xi = Log(mount.T_camera_rig);
    text += fmt::format("{},{},{:.12g},{:.6g}\n",
                        CsvCell(names[mount.calibration]),
                        merged.record.cameras[mount.camera].name,
                        fmt::join(xi, ","),
                        fmt::join(mount.sigma_xi, ","));
  }
  return text;
}

// A line a calibration: how far it is from all together, and where farthest.
std::string DeviationsText(const MergedCalibrations& merged,
                           const std::vector<std::string>& names) {
  std::string text = fmt::format(
      "{:<40} {:>10}  farthest from the merged calibration\n", "calibration", "RMS sigmas");
  for (size_t p = 0; p < names.size(); ++p) {
    double squares = 0;
    int count = 0;
    const MergeDeviation* farthest = nullptr;
    for (const MergeDeviation& deviation : merged.deviations) {
      if (deviation.calibration != p || !(deviation.sigma > 0)) continue;
      squares += deviation.InSigmas() * deviation.InSigmas();
      ++count;
      if (farthest == nullptr || deviation.InSigmas() > farthest->InSigmas()) {
        farthest = &deviation;
      }
    }
    text += fmt::format("{:<40} ", names[p]);
    text += farthest == nullptr ? fmt::format("{:>10}  has nothing in common with others\n", "")
                                : fmt::format("{:>10.2f}  {} by {}, {:.1f} sigma\n",
                                              std::sqrt(squares / count),
                                              NameOfDeviation(merged, *farthest),
                                              SizeOfDeviation(merged, *farthest),
                                              farthest->InSigmas());
  }
  if (merged.degrees <= 0) return text;
  text += fmt::format("chi-square of all deviations: {:.1f} at {}",
                      merged.chi_square,
                      Counted(merged.degrees, "degree") + " of freedom");
  return text + (merged.scale == 1
                     ? "; the calibrations agree\n"
                     : fmt::format("; the calibrations disagree, and standard errors were scaled "
                                   "by {:.2f}\n",
                                   merged.scale));
}

void RunMerge(const MergeArguments& arguments, const ConsoleOptions& shared) {
  OutputFolder out(arguments.out);
  out.RefuseInputs({"calibration.yaml", "correlations.csv", "merge.csv", "mounts.csv"});
  const std::vector<CalibrationRecord> records = ReadAll(arguments);
  RefuseRepeated(records);
  const MergeOptions options{.moved = arguments.moved};
  MergedCalibrations merged = MergeCalibrations(records, options);
  std::vector<std::string> names;
  for (const CalibrationRecord& record : records) {
    names.push_back(record.path.string());
    merged.record.provenance.emplace_back(fmt::format("merged_{}", names.size()),
                                          record.path.string());
  }
  merged.record.provenance.emplace_back("plenocal_version", PLENOCAL_VERSION);
  merged.record.findings = FindingsOfMerge(merged, records, options);
  Verdict verdict{.grade = Grade::kGood, .findings = merged.record.findings};
  for (const Finding& finding : verdict.findings) {
    verdict.grade = std::max(verdict.grade, finding.grade);
  }
  merged.record.verdict = verdict;
  CopyCameraFiles(records, &merged.record, &out);
  out.Write("calibration.yaml", CalibrationYaml(merged.record));
  out.Write("correlations.csv", CorrelationsCsv(merged.record.correlations));
  out.Write("merge.csv", MergeCsv(merged, names));
  if (!merged.mounts.empty()) out.Write("mounts.csv", MountsCsv(merged, names));
  out.Remove("mounts.csv");
  out.Commit();

  std::string text;
  for (const CalibratedCamera& camera : merged.record.cameras) text += CameraText(camera);
  text += MountsText(merged, names) + "\n" + DeviationsText(merged, names);
  for (const Finding& finding : verdict.findings) {
    text += fmt::format("\n{} {}\n", finding.what, finding.remedy);
  }
  Console(shared).Print(fmt::format("{}\nwritten to {}\n", text, arguments.out.string()));
}

constexpr const char* kMergeHelp =
    "Several calibrations of one rig as one: of several days, or of subsets of its cameras.\n"
    "\n"
    "  plenocal merge MONDAY FRIDAY -o OUT\n"
    "\n"
    "writes OUT/calibration.yaml with one covariance (correlations.csv), and merge.csv: how far each calibration is from all together. What differs by more than the standard errors explain is named. Cameras that moved on the rig in between get a place in each calibration by --moved; the result has the last one.";

RunCommand DeclareMerge(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<MergeArguments>();
  app->add_option("calibrations",
                  arguments->calibrations,
                  "folders that 'plenocal calibrate' wrote, or their calibration.yaml")
      ->required()
      ->expected(2, -1);
  app->add_option("--moved",
                  arguments->moved,
                  "cameras that moved on the rig between the calibrations, separated by commas")
      ->delimiter(',');
  app->add_option("-o,--out", arguments->out, "folder for the results")->required();
  AddQuiet(app, shared);
  return [arguments, shared] { RunMerge(*arguments, *shared); };
}

}  // namespace

Command MergeCommand() { return {"merge", kMergeHelp, DeclareMerge}; }

}  // namespace plenocal
