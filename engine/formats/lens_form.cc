// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/lens_form.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <span>

#include "assess/convert.h"
#include "calib/base/format_error.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr std::array<std::string_view, 4> kIntrinsics{"f_x", "f_y", "c_x", "c_y"};

std::optional<double> Value(const CalibratedCamera& camera, std::string_view name) {
  for (size_t i = 0; i < camera.params.size(); ++i) {
    if (camera.model->params[i].name == name) return camera.params[i];
  }
  return std::nullopt;
}

bool Holds(std::span<const std::string_view> names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// The first parameter that is not zero and not in the form.
std::optional<Param> Lost(const CalibratedCamera& camera, const LensForm& form) {
  for (size_t i = 0; i < camera.params.size(); ++i) {
    const Param& param = camera.model->params[i];
    if (camera.params[i] == 0 || Holds(kIntrinsics, param.name) ||
        Holds(form.coefficients, param.name)) {
      continue;
    }
    return param;
  }
  return std::nullopt;
}

/// Coefficient `i` of the lens; missing ones are zero.
double Coefficient(const Lens& lens, size_t i) {
  return i < lens.coefficients.size() ? lens.coefficients[i] : 0;
}

/// True when the form has the lens' name and all its coefficients that are not zero.
bool Fits(const LensForm& form, const Lens& lens) {
  if (form.name != lens.name) return false;
  for (size_t i = 0; i < lens.coefficients.size(); ++i) {
    const bool has_place = i < form.coefficients.size() && form.coefficients[i] != "0";
    if (!has_place && lens.coefficients[i] != 0) return false;
  }
  return true;
}

/// A parameter of a model by its name; zero when it is not in the form.
double ParamOf(const Lens& lens, const LensForm& form, std::string_view name) {
  const std::array intrinsics{lens.f_x, lens.f_y, lens.c_x, lens.c_y};
  if (const auto found = std::ranges::find(kIntrinsics, name); found != kIntrinsics.end()) {
    return intrinsics[static_cast<size_t>(found - kIntrinsics.begin())];
  }
  const auto found = std::ranges::find(form.coefficients, name);
  if (found == form.coefficients.end()) return 0;
  return Coefficient(lens, static_cast<size_t>(found - form.coefficients.begin()));
}

/// `lens` has the centre of the top-left pixel at (0, 0).
CalibratedCamera MakeCamera(const Lens& lens,
                            const LensForm& form,
                            const CameraModel& model,
                            const std::string& where) {
  CalibratedCamera camera;
  camera.model = &model;
  for (const Param& param : model.params) {
    const double value = ParamOf(lens, form, param.name);
    if (!(value > param.lower && value < param.upper)) {
      throw InputError(
          "{}: {} = {} is outside ({}, {})", where, param.name, value, param.lower, param.upper);
    }
    camera.params.push_back(value);
  }
  return camera;
}

/// Keys of a lens' numbers.
std::vector<std::string> KeysOf(const std::string& name, const LensTable& table) {
  std::vector<std::string> keys(table.keys.begin(), table.keys.end());
  const auto found = table.coefficient_keys.find(name);
  if (found == table.coefficient_keys.end()) return keys;
  for (const std::string_view key : WordsOf(found->second)) keys.emplace_back(key);
  return keys;
}

/// Of the models that the tool holds the one that differs least from the camera, for a message.
std::string NearestText(const CalibratedCamera& camera, const LensTable& table) {
  if (camera.model->centre == Centre::kAxis) {
    return "; it has no single centre: 'plenocal convert --to MODEL --distance METRES' makes a "
           "camera of a central model, exact at one distance";
  }
  std::optional<std::pair<Conversion, std::string_view>> nearest;
  for (const LensForm& form : table.forms) {
    const CameraModel* const model = FindModel(CameraModels(), form.model);
    if (model == nullptr || model == camera.model) continue;
    try {
      CalibratedCamera converted = camera;
      Conversion conversion = Convert(camera, *model);
      converted.model = model;
      converted.params = conversion.params;
      const bool sees_all = conversion.unseen == 0 && std::isfinite(conversion.rms);
      if (!sees_all || Lost(converted, form)) continue;
      if (nearest && nearest->first.rms <= conversion.rms) continue;
      nearest.emplace(std::move(conversion), form.model);
    } catch (const Error&) {
      continue;  // not central, or too narrow for the camera
    }
  }
  if (!nearest) {
    return "; no model that it takes images all that this camera sees; 'plenocal undistort' makes "
           "images of a pinhole camera";
  }
  return fmt::format(
      "; of the models that it takes {0} differs least, {1:.2g} px RMS and at most {2:.2g} px: "
      "plenocal convert CALIBRATION --to {0}",
      nearest->second,
      nearest->first.rms,
      nearest->first.largest);
}

}  // namespace

std::vector<std::string_view> WordsOf(std::string_view text) {
  std::vector<std::string_view> words;
  while (!text.empty()) {
    words.push_back(text.substr(0, text.find(' ')));
    text.remove_prefix(std::min(text.size(), words.back().size() + 1));
  }
  return words;
}

std::vector<double> Lens::Numbers() const {
  std::vector<double> numbers{f_x, f_y, c_x, c_y};
  numbers.insert(numbers.end(), coefficients.begin(), coefficients.end());
  return numbers;
}

Lens LensOfNumbers(std::string name, const std::vector<double>& numbers) {
  return {std::move(name),
          numbers[0],
          numbers[1],
          numbers[2],
          numbers[3],
          {numbers.begin() + 4, numbers.end()}};
}

std::vector<std::pair<std::string, double>> Lens::Entries(const LensTable& table) const {
  const std::vector<std::string> keys = KeysOf(name, table);
  const std::vector<double> numbers = Numbers();
  std::vector<std::pair<std::string, double>> entries;
  for (size_t i = 0; i < keys.size(); ++i) entries.emplace_back(keys[i], numbers[i]);
  return entries;
}

Lens ReadLensEntries(const YamlNode& node,
                     const std::string& name,
                     const LensTable& table,
                     const std::string& prefix) {
  std::vector<double> numbers;
  for (const std::string& key : KeysOf(name, table)) {
    const bool lacks = table.may_lack_coefficients && numbers.size() >= kIntrinsics.size() &&
                       !node.Has(prefix + key);
    numbers.push_back(lacks ? 0 : node.At(prefix + key).AsNumber());
  }
  return LensOfNumbers(name, numbers);
}

Lens ToLens(const CalibratedCamera& camera, const LensTable& table) {
  std::optional<Param> lost;
  for (const LensForm& form : table.forms) {
    if (form.model != camera.model->name) continue;
    lost = Lost(camera, form);
    if (lost) continue;
    Lens lens{std::string(form.name),
              *Value(camera, "f_x"),
              *Value(camera, "f_y"),
              *Value(camera, "c_x") + table.first_pixel,
              *Value(camera, "c_y") + table.first_pixel,
              {}};
    for (const std::string_view name : form.coefficients) {
      lens.coefficients.push_back(name == "0" ? 0 : *Value(camera, name));
    }
    return lens;
  }
  throw JobError(
      "camera '{}': {}{}",
      camera.name,
      lost ? fmt::format(
                 "{} has no place for {} of model {}", table.tool, lost->name, camera.model->name)
           : fmt::format("{} cannot hold model {}", table.tool, camera.model->name),
      NearestText(camera, table));
}

CalibratedCamera FromLens(const Lens& lens,
                          ImageSize image_size,
                          const LensTable& table,
                          const std::string& where) {
  Lens from_zero = lens;
  from_zero.c_x -= table.first_pixel;
  from_zero.c_y -= table.first_pixel;
  std::vector<std::string_view> names;
  std::set<size_t> counts;
  for (const LensForm& form : table.forms) {
    if (!Holds(names, form.name)) names.push_back(form.name);
    if (form.name == lens.name) counts.insert(form.coefficients.size());
    if (table.has_all_coefficients && form.coefficients.size() != lens.coefficients.size())
      continue;
    const CameraModel* const model = FindModel(CameraModels(), form.model);
    if (model == nullptr || !Fits(form, lens)) continue;
    CalibratedCamera camera = MakeCamera(from_zero, form, *model, where);
    camera.image_size = image_size;
    return camera;
  }
  if (!Holds(names, lens.name)) {
    throw InputError(
        "{}: the lens '{}' is not read{}", where, lens.name, SuggestName(lens.name, names));
  }
  if (table.has_all_coefficients && !counts.contains(lens.coefficients.size())) {
    throw InputError("{}: the lens '{}' has {} coefficients, not {}",
                     where,
                     lens.name,
                     fmt::join(counts, " or "),
                     lens.coefficients.size());
  }
  throw InputError(
      "{}: no camera model of this plenocal has all coefficients [{}] of the lens '{}'",
      where,
      fmt::join(lens.coefficients, ", "),
      lens.name);
}

CalibratedCamera PanoramaCamera(ImageSize image_size, const std::array<double, 4>& params) {
  CalibratedCamera camera;
  camera.model = FindModel(CameraModels(), "spherical");
  camera.image_size = image_size;
  camera.params.assign(params.begin(), params.end());
  return camera;
}

void CheckPanorama(const CalibratedCamera& camera,
                   const std::array<double, 4>& params,
                   std::string_view tool) {
  constexpr double kSame = 1e-7;  // px, and px / rad
  for (size_t i = 0; i < params.size(); ++i) {
    if (std::abs(camera.params[i] - params[i]) < kSame) continue;
    throw JobError(
        "camera '{}': {} takes the parameters from the size of a spherical image, {} = {}, this one "
        "has {}; calibrate with 'initial: {{f_x: {}, f_y: {}, c_x: {}, c_y: {}}}' and "
        "'fixed: [f_x, f_y, c_x, c_y]'",
        camera.name,
        tool,
        kIntrinsics.at(i),
        params[i],
        camera.params[i],
        params[0],
        params[1],
        params[2],
        params[3]);
  }
}

void RequireOneFocalLength(const CalibratedCamera& camera,
                           const Lens& lens,
                           std::string_view tool) {
  if (lens.f_x == lens.f_y) return;
  const double most = 0.25 * std::max(camera.image_size[0] * std::abs(1 - lens.f_y / lens.f_x),
                                      camera.image_size[1] * std::abs(1 - lens.f_x / lens.f_y));
  throw JobError(
      "camera '{}': {} has one focal length, this camera has f_x = {} and f_y = {}; write their mean "
      "into a copy of calibration.yaml and export that: points move by up to {:.2g} px",
      camera.name,
      tool,
      lens.f_x,
      lens.f_y,
      most);
}

Lens ScaledPlane(const Lens& lens, double scale, double first) {
  Lens scaled = lens;
  scaled.f_x *= scale;
  scaled.f_y *= scale;
  scaled.coefficients[0] = first;
  constexpr std::array<double, 4> kPowers{2, 4, 1, 1};  // of k_1 k_2 p_1 p_2
  for (size_t i = 1; i < std::min(scaled.coefficients.size(), kPowers.size() + 1); ++i) {
    scaled.coefficients[i] *= std::pow(scale, kPowers[i - 1]);
  }
  return scaled;
}

Lens FromOmni(const Lens& omni) {
  const double xi = omni.coefficients[0];
  Lens lens = ScaledPlane(omni, 1 / (1 + xi), xi / (1 + xi));
  const bool is_plain = std::all_of(lens.coefficients.begin() + 1,
                                    lens.coefficients.end(),
                                    [](double value) { return value == 0; });
  lens.name = is_plain ? "omni none" : "omni radtan";
  if (is_plain) lens.coefficients.resize(1);
  return lens;
}

const std::array<LensForm, 2>& OmniForms() {
  static const std::array<LensForm, 2> kForms{
      LensForm("ucm", "omni none", "alpha"),
      LensForm("ucm+radtan", "omni radtan", "alpha k_1 k_2 p_1 p_2")};
  return kForms;
}

const LensTable& OpenCvLenses() {
  static const LensTable kTable{
      "opencv",
      {{"pinhole", "radtan", "0 0 0 0 0"},
       {"pinhole-radial3", "radtan", "A_0 A_1 0 0 A_2"},
       {"pinhole-radtan4", "radtan", "k_1 k_2 p_1 p_2"},
       {"pinhole-radtan", "radtan", "k_1 k_2 p_1 p_2 k_3"},
       {"pinhole-radtan8", "radtan", "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6"},
       {"pinhole-radtan12", "radtan", "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6 s_1 s_2 s_3 s_4"},
       {"pinhole-radtan12+tilt",
        "radtan",
        "k_1 k_2 p_1 p_2 k_3 k_4 k_5 k_6 s_1 s_2 s_3 s_4 tau_x tau_y"},
       {"kannala-brandt4", "fisheye", "k_1 k_2 k_3 k_4"}}};
  return kTable;
}

}  // namespace plenocal
