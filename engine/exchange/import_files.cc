// SPDX-License-Identifier: Apache-2.0
#include "engine/exchange/import_files.h"

#include <cctype>
#include <set>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/quoted_text.h"
#include "calib/files/calibration_file.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/import_format.h"
#include "engine/formats/pose_matrices.h"

namespace plenocal {
namespace {

/// A name that can be a key and part of file names: as it is or, if it cannot be one, without its
/// unusual characters.
std::string NameInFile(std::string name) {
  if (!CameraNameDefect(name)) return name;
  for (char& c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-') c = '_';
  }
  return name.empty() ? "camera" : name;
}

std::vector<CalibratedCamera> ReadCameras(const ImportRequest& request,
                                          const CameraFormat& format) {
  std::vector<CalibratedCamera> all;
  std::set<std::string> names;
  for (const std::filesystem::path& file : request.files) {
    for (CalibratedCamera& camera : ReadCameraFile(format, {file, request.size, request.fisheye})) {
      camera.name = NameInFile(camera.name.empty() ? file.stem().string() : camera.name);
      if (!names.insert(camera.name).second) {
        throw InputError("two cameras are called '{}'; rename a file", camera.name);
      }
      all.push_back(std::move(camera));
    }
  }
  MakeFirstMaster(&all);
  return all;
}

[[noreturn]] void RefuseFormat(const std::string& name) {
  std::vector<std::string_view> names = NamesOf(ImportFormats());
  for (const CameraFormat& format : CameraFormats()) names.push_back(format.name);
  throw InputError("--format: unknown '{}'{}", name, SuggestName(name, names));
}

void RequireOneFile(const ImportRequest& request) {
  if (request.files.size() == 1) return;
  throw InputError("format {} takes one file", request.format);
}

/// A file made, and its name where the user gives a folder.
struct Made {
  std::string name;
  ImportedFile file;
};

Made Import(const ImportRequest& request) {
  const std::filesystem::path& source = request.files[0];
  if (const CameraFormat* format = FindCameraFormat(request.format, source)) {
    if (!format->holds_extrinsics) RequireOneFile(request);
    return {"calibration.yaml",
            {GivenCamerasYaml(ReadCameras(request, *format), {}), /*message=*/{}}};
  }
  const ImportFormat* const format = FindImportFormat(request.format);
  if (format == nullptr) RefuseFormat(request.format);
  RequireOneFile(request);
  constexpr std::string_view kStem = "<file>";
  std::string name(format->result);
  if (const size_t at = name.find(kStem); at != std::string::npos) {
    name.replace(at, kStem.size(), NameInFile(source.stem().string()));
  }
  return {name, format->read({source, request.size})};
}

}  // namespace

std::filesystem::path ImportFiles(const ImportRequest& request, const Run& run) {
  const RunScope inputs;
  const Made made = Import(request);
  if (!made.file.message.empty()) run.Message(made.file.message);
  // A path with the extension of the result is the file to write, any other a folder.
  const bool is_file = request.out.extension() == std::filesystem::path(made.name).extension();
  OutputContents files = made.file.beside;
  files.emplace(
      files.begin(), is_file ? request.out.filename().string() : made.name, made.file.content);
  return (is_file ? WriteOutputs(request.out, files) : WriteInto(request.out, files))[0];
}

}  // namespace plenocal
