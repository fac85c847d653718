// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <memory>
#include <optional>
#include <set>

#include "apps/cli/command.h"
#include "apps/cli/options.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/files/calibration_file.h"
#include "calib/io/output_folder.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/import_format.h"
#include "engine/formats/poses.h"

namespace plenocal {
namespace {

/// Files of another tool.
struct ImportArguments {
  std::vector<std::filesystem::path> files;
  std::string format;
  std::optional<ImageSize> size;  ///< for files that hold none
  bool fisheye = false;           ///< for files of OpenCV that do not mark fisheye coefficients
  std::filesystem::path out;      ///< folder, or the file to write
};

/// A name that can be a key and part of file names.
std::string NameInFile(std::string name) {
  for (char& c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-') c = '_';
  }
  return name.empty() ? "camera" : name;
}

std::vector<CalibratedCamera> ReadCameras(const ImportArguments& arguments,
                                          const CameraFormat& format) {
  std::vector<CalibratedCamera> all;
  std::set<std::string> names;
  for (const std::filesystem::path& file : arguments.files) {
    for (CalibratedCamera& camera :
         ReadCameraFile(format, {file, arguments.size, arguments.fisheye})) {
      camera.name = NameInFile(camera.name.empty() ? file.stem().string() : camera.name);
      if (!names.insert(camera.name).second) {
        throw Error(ErrorKind::kInput,
                    fmt::format("two cameras are called '{}'; rename a file", camera.name));
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
  throw Error(ErrorKind::kInput,
              fmt::format("--format: unknown '{}'{}", name, SuggestName(name, names)));
}

void RequireOneFile(const ImportArguments& arguments) {
  if (arguments.files.size() == 1) return;
  throw Error(ErrorKind::kInput, fmt::format("format {} takes one file", arguments.format));
}

/// A file made, and its name where the user gives a folder.
struct Made {
  std::string name;
  ImportedFile file;
};

Made Import(const ImportArguments& arguments) {
  const std::filesystem::path& source = arguments.files[0];
  if (const CameraFormat* format = FindCameraFormat(arguments.format, source)) {
    if (!format->holds_extrinsics) RequireOneFile(arguments);
    return {"calibration.yaml",
            {GivenCamerasYaml(ReadCameras(arguments, *format), {}), /*message=*/{}}};
  }
  const ImportFormat* const format = FindImportFormat(arguments.format);
  if (format == nullptr) RefuseFormat(arguments.format);
  RequireOneFile(arguments);
  constexpr std::string_view kStem = "<file>";
  std::string name(format->result);
  if (const size_t at = name.find(kStem); at != std::string::npos) {
    name.replace(at, kStem.size(), NameInFile(source.stem().string()));
  }
  return {name, format->read({source, arguments.size})};
}

void RunImport(const ImportArguments& arguments, const ConsoleOptions& shared) {
  Console console(shared);
  const Made made = Import(arguments);
  if (!made.file.message.empty()) console.Message(made.file.message);
  // A path with the extension of the result is the file to write, any other a folder.
  const bool is_file = arguments.out.extension() == std::filesystem::path(made.name).extension();
  OutputContents files = made.file.beside;
  files.emplace(
      files.begin(), is_file ? arguments.out.filename().string() : made.name, made.file.content);
  const auto written =
      is_file ? WriteOutputs(arguments.out, files) : WriteInto(arguments.out, files);
  console.Print(fmt::format("written to {}\n", written[0].string()));
}

std::string ImportHelp() {
  return fmt::format(
      "Another tool's file as one of plenocal.\n\n"
      "  plenocal import camchain.yaml --format kalibr -o OUT\n\n"
      "Formats: those of 'plenocal export' give OUT/calibration.yaml; {}.",
      ImportFormatList());
}

RunCommand DeclareImport(CLI::App* app, ConsoleOptions* shared) {
  const auto arguments = std::make_shared<ImportArguments>();
  app->add_option("file", arguments->files, "the other tool's file; of mrcal one a camera")
      ->required();
  app->add_option("--format", arguments->format, "the other tool")->required();
  AddImageSize(app, &arguments->size, "WIDTHxHEIGHT of the images where the file does not hold it");
  app->add_flag("--fisheye",
                arguments->fisheye,
                "opencv: the coefficients are cv::fisheye's where the file does not mark them");
  app->add_option("-o,--out", arguments->out, "folder, or the file to write")->required();
  AddQuiet(app, shared);
  return [arguments, shared] { RunImport(*arguments, *shared); };
}

}  // namespace

Command ImportCommand() { return {"import", ImportHelp(), DeclareImport}; }

}  // namespace plenocal
