// SPDX-License-Identifier: Apache-2.0
#include "engine/rigs/merge_calibrations.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "assess/verdict.h"
#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "calib/io/yaml.h"
#include "engine/session/calibration_folder.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

std::vector<CalibrationRecord> ReadAll(const MergeRequest& request) {
  std::vector<CalibrationRecord> records;
  for (const fs::path& argument : request.calibrations) {
    const fs::path path = fs::is_directory(argument) ? argument / "calibration.yaml" : argument;
    records.push_back(OpenWithCorrelations(path));
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

// Refuses calibrations of which one contains the other: it would count twice.
void RefuseRepeated(const std::vector<CalibrationRecord>& records) {
  for (size_t i = 0; i < records.size(); ++i) {
    for (size_t j = 0; j < records.size(); ++j) {
      if (j < i && IsSameFile(records[i].path, records[j].path)) {
        throw InputError("{}: is given twice", records[i].path.string());
      }
      for (const fs::path& earlier : EarlierFilesOf(records[i])) {
        if (i == j || !IsSameFile(earlier, records[j].path)) continue;
        throw InputError(
            "{0}: was calibrated from {1}, which it contains already; leave "
            "{1} out",
            records[i].path.string(),
            records[j].path.string());
      }
    }
  }
}

// The micro lenses and the attenuation of each camera, those of the last calibration that has them.
void CopyCameraFiles(const std::vector<CalibrationRecord>& records,
                     CalibrationRecord* merged,
                     OutputFolder* out) {
  for (CalibratedCamera& camera : merged->cameras) {
    for (const auto member : {&CalibratedCamera::micro_lenses,
                              &CalibratedCamera::lattice,
                              &CalibratedCamera::vignetting}) {
      fs::path file;
      for (const CalibrationRecord& record : records) {
        for (const CalibratedCamera& other : record.cameras) {
          if (other.name != camera.name || (other.*member).empty()) continue;
          file = FileBeside(record, other.*member);
        }
      }
      if (file.empty()) continue;
      camera.*member = file.filename().string();
      out->Write(camera.*member, ReadInput(file, InputLimit::kTable));
    }
  }
}

std::string MergeCsv(const MergedFiles& result) {
  const auto& [merged, names] = result;
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

std::string MountsCsv(const MergedFiles& result) {
  const auto& [merged, names] = result;
  std::string text =
      "calibration,camera,x,y,z,w_x,w_y,w_z,sigma_x,sigma_y,sigma_z,sigma_w_x,sigma_w_y,sigma_w_z\n";
  for (const MovedExtrinsics& mount : merged.mounts) {
    const Vector6d xi = Log(mount.T_camera_rig);
    text += fmt::format("{},{},{:.12g},{:.6g}\n",
                        CsvCell(names[mount.calibration]),
                        merged.record.cameras[mount.camera].name,
                        fmt::join(xi, ","),
                        fmt::join(mount.sigma_xi, ","));
  }
  return text;
}

}  // namespace

MergedFiles MergeFiles(const MergeRequest& request, const Run& run) {
  const RunScope inputs;
  const auto out = OpenOutput(request.out);
  if (out) out->RefuseInputs({"calibration.yaml", "correlations.csv", "merge.csv", "mounts.csv"});
  const std::vector<CalibrationRecord> records = ReadAll(request);
  RefuseRepeated(records);
  if (!run.Progress("merge")) throw Stopped();
  const MergeOptions options{.moved = request.moved};
  MergedFiles result{MergeCalibrations(records, options), {}};
  for (const CalibrationRecord& record : records) {
    result.names.push_back(record.path.string());
    result.merged.record.provenance.emplace_back(fmt::format("merged_{}", result.names.size()),
                                                 record.path.string());
  }
  result.merged.record.provenance.emplace_back("plenocal_version", PLENOCAL_VERSION);
  result.merged.record.findings = FindingsOfMerge(result.merged, records, options);
  Verdict verdict{.grade = Grade::kGood, .findings = result.merged.record.findings};
  for (const Finding& finding : verdict.findings) {
    verdict.grade = std::max(verdict.grade, finding.grade);
  }
  result.merged.record.verdict = verdict;
  if (!out) return result;
  CopyCameraFiles(records, &result.merged.record, out.get());
  out->Write("calibration.yaml", CalibrationYaml(result.merged.record));
  out->Write("correlations.csv", CorrelationsCsv(result.merged.record.correlations));
  out->Write("merge.csv", MergeCsv(result));
  if (!result.merged.mounts.empty()) out->Write("mounts.csv", MountsCsv(result));
  out->Remove("mounts.csv");
  out->Commit();
  return result;
}

}  // namespace plenocal
