// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/api.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "apps/print/print_target.h"
#include "apps/suggest/suggestions_json.h"
#include "apps/workbench/image_answer.h"
#include "apps/workbench/project/beneath.h"
#include "apps/workbench/project/camera_folder.h"
#include "apps/workbench/project/command_text.h"
#include "apps/workbench/project/session_text.h"
#include "apps/workbench/run_json.h"
#include "apps/workbench/session_fields.h"
#include "assess/text/compare_text.h"
#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/files/frame_images.h"
#include "calib/io/detection_cache.h"
#include "calib/io/yaml.h"
#include "engine/compare_files.h"
#include "engine/exchange/export_calibration.h"
#include "engine/formats/camera_format.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/suggest_views.h"
#include "models/registry.h"
#include "targets/target.h"

namespace plenocal::workbench {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr size_t kMostText = 1024 * 1024;
// In the root.
constexpr const char* kTry = ".plenocal/try";
constexpr const char* kDrawings = ".plenocal/drawing";
constexpr const char* kCache = ".plenocal/cache";  // of detections, for all runs

Answer JsonAnswer(const Json& json, int status = 200) {
  return {.status = status, .body = JsonText(json, -1)};
}

Answer NoAnswer() { return ErrorAnswer(404, "the workbench has no such address"); }

Json BodyOf(const Request& request) {
  Json body = Json::parse(request.body.empty() ? "{}" : request.body, nullptr, false);
  if (!body.is_object()) throw InputError("the request's body is no JSON object");
  return body;
}

// The value of a key; null where it is missing. Refuses one that is not `what`.
Json PartOf(const Json& body,
            const char* key,
            bool (Json::*is)() const noexcept,
            const char* what) {
  const auto found = body.find(key);
  if (found == body.end() || found->is_null()) return nullptr;
  if (!((*found).*is)()) throw InputError("{}: expected {}", key, what);
  return *found;
}

std::string TextOf(const Json& body, const char* key) {
  const Json text = PartOf(body, key, &Json::is_string, "text");
  return text.is_null() ? std::string() : text.get<std::string>();
}

// The text of a key that must be there.
std::string NeededText(const Json& body, const char* key) {
  const Json text = PartOf(body, key, &Json::is_string, "text");
  if (text.is_null()) throw InputError("{}: expected text", key);
  return text.get<std::string>();
}

int IntOf(const Json& number, const char* key) {
  // Doubles hold more than the range, and large unsigned numbers as such.
  const auto value = number.get<double>();
  if (std::abs(value) > std::numeric_limits<int>::max()) {
    throw InputError("{}: {} is too large", key, number.dump());
  }
  return number.get<int>();
}

int NumberOf(const Json& body, const char* key, int otherwise) {
  const Json number = PartOf(body, key, &Json::is_number_integer, "a number");
  return number.is_null() ? otherwise : IntOf(number, key);
}

int NumberOf(const std::string& text, const char* what) {
  int number = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), number);
  if (parsed.ec != std::errc() || parsed.ptr != text.data() + text.size() || number < 0) {
    throw InputError("{}: expected a number, got '{}'", what, text);
  }
  return number;
}

bool Is(const Request& request, const char* method, std::initializer_list<const char*> path) {
  if (request.method != method || request.path.size() != path.size() + 1) return false;
  size_t i = 1;
  for (const char* part : path) {
    if (std::string_view(part) != "*" && request.path[i] != part) return false;
    ++i;
  }
  return true;
}

// A name that is no option and no path.
std::string PlainName(const std::string& name, const char* what) {
  if (name.empty() || name.starts_with('-') || name.starts_with('.') ||
      name.find('/') != std::string::npos) {
    throw InputError("{}: '{}' is no name", what, name);
  }
  return name;
}

ExcludeRule RuleOf(const Json& body) {
  ExcludeRule rule{.camera = TextOf(body, "camera"),
                   .frame = TextOf(body, "frame"),
                   .note = TextOf(body, "note")};
  for (const Json& marker : PartOf(body, "markers", &Json::is_array, "a list")) {
    if (!marker.is_number_integer()) throw InputError("markers: expected numbers");
    rule.markers.push_back(IntOf(marker, "markers"));
  }
  if (rule.frame.empty() && rule.markers.empty()) {
    throw InputError("give the frame or the markers to exclude");
  }
  return rule;
}

// Of the results of `focus`, in the root.
fs::path FocusFolder(int run, const std::string& camera, const std::string& frame) {
  return fs::path(".plenocal") / "focus" / std::to_string(run) / camera / frame;
}

// Scalars without quotes are numbers where they can be; infinite ones are null, as what is missing
// is.
nlohmann::ordered_json YamlJson(const YamlNode& yaml) {
  nlohmann::ordered_json json;
  if (yaml.IsMap()) {
    for (const auto& [key, value] : yaml.Entries()) json[key] = YamlJson(value);
  } else if (yaml.IsSequence()) {
    for (const YamlNode& element : yaml.Elements()) json.push_back(YamlJson(element));
  } else if (const std::string text = yaml.AsString(); yaml.IsQuoted()) {
    return text;
  } else if (text != ".inf") {
    if (const auto number = ParseDouble(text)) return *number;
    return text;
  }
  return json;
}

}  // namespace

Api::Api(Project* project, Jobs* jobs, EventLog* events)
    : project_(project), jobs_(jobs), events_(events), images_(project->Root()), watch_(project) {}

Answer Api::Handle(const Request& request) {
  try {
    return AnswerTo(request);
  } catch (const Error& error) {
    return ErrorAnswer(400, project_->Relative(error.what()));
  }
}

Answer Api::AnswerTo(const Request& request) {
  if (Is(request, "GET", {"state"})) return State();
  if (Is(request, "GET", {"files"})) return Files(request);
  if (Is(request, "POST", {"files"})) return AddImage(request);
  if (Is(request, "POST", {"look"})) return Look(request);
  if (Is(request, "POST", {"look", "keep"})) return Keep(request);
  if (request.path.size() >= 2 && request.path[1] == "session") return SessionRequest(request);
  if (Is(request, "POST", {"jobs"})) return AddJob(request);
  if (Is(request, "POST", {"watch"})) return WatchRequest(request);
  if (Is(request, "DELETE", {"jobs", "*"})) {
    const bool stopped = jobs_->Stop(NumberOf(request.path[2], "job"));
    return stopped ? JsonAnswer(Json::object()) : ErrorAnswer(404, "no such job is running");
  }
  if (Is(request, "GET", {"image", "*", "*"})) return Image(request);
  if (request.method == "GET" && request.path.size() >= 3 && request.path[1] == "runs") {
    return Run(request);
  }
  if (Is(request, "POST", {"suggest"})) return Suggest(request);
  if (Is(request, "GET", {"compare"})) return Compare(request);
  if (Is(request, "GET", {"try"})) return Tried();
  if (Is(request, "POST", {"drawing"})) return DrawTarget();
  if (Is(request, "GET", {"drawing", "*", "*"})) return Sheet(request);
  return NoAnswer();
}

Answer Api::State() {
  Json session = nullptr;
  if (project_->HasSession()) {
    const SessionVersion version = project_->ReadVersion();
    session = {{"path", project_->SessionFile().string()},
               {"hash", version.hash},
               {"undo", version.undo},
               {"redo", version.redo}};
  }
  Json runs = Json::array();
  for (const int run : project_->Runs())
    runs.push_back(RunBriefJson(project_->RunFolder(run), run));
  Json formats = Json::array();
  for (const CameraFormat& format : CameraFormats()) {
    if (format.variant_of.empty()) formats.push_back(format.name);
  }
  return JsonAnswer({{"root", project_->Root().string()},
                     {"session", session},
                     {"jobs", jobs_->All()},
                     {"runs", runs},
                     {"watching", watch_.On()},
                     {"formats", formats},
                     {"event", events_->Last()}});
}

// Folders with images beneath the root, to begin with.
Answer Api::Files(const Request& request) const {
  std::error_code error;
  const fs::path folder = fs::canonical(project_->Root() / request.Query("dir"), error);
  // No link leads out of the root.
  (void)RelativeTo(project_->Root(), folder);
  Json entries = Json::array();
  constexpr size_t kMost = 10'000;
  size_t images = 0;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with('.') || entries.size() > kMost) continue;
    if (entry.is_directory(error) && !entry.is_symlink(error)) {
      size_t count = 0;
      for (const auto& file : fs::directory_iterator(entry.path(), error)) {
        if (HasImageName(file.path())) ++count;
      }
      entries.push_back({{"name", name}, {"kind", "dir"}, {"count", count}});
    } else if (HasImageName(entry.path())) {
      ++images;
    } else if (!entry.is_symlink(error) && !SplitStorePattern(entry.path()).file.empty()) {
      entries.push_back({{"name", name}, {"kind", "recording"}, {"count", 1}});
    }
  }
  return JsonAnswer({{"dir", request.Query("dir")}, {"images", images}, {"entries", entries}});
}

// An image or a recording of the page's machine: into the folder `dir`, or to the images of a
// camera of the session. A name that no session could read is refused.
Answer Api::AddImage(const Request& request) {
  const std::string name = PlainName(request.Query("name"), "name");
  const std::string camera = request.Query("camera");
  std::string folder = request.Query("dir");
  if (!folder.empty()) (void)PlainName(folder, "dir");
  for (const std::string& each : {folder, name}) {
    const auto defect = each.empty() ? std::nullopt : FrameNameDefect(each);
    if (!defect) continue;
    throw InputError("the name '{}' {}; rename it", each, *defect);
  }
  if (!HasImageName(name) && !IsStoreName(name)) {
    throw InputError("{}: is no image and no recording", name);
  }
  if (!camera.empty()) folder = FolderFor(camera, name);
  AddBeneath(project_->Root(), folder, name, request.body);
  return JsonAnswer(Json::object(), 201);
}

// The folder to which an image of this name can be added, so that the session reads it as one of
// the camera.
std::string Api::FolderFor(const std::string& camera, const std::string& name) {
  const Session session = project_->Parsed();
  const auto of = std::ranges::find(session.cameras, camera, &SessionCamera::name);
  if (of == session.cameras.end()) throw InputError("the session has no camera '{}'", camera);
  const auto place = FolderOf(project_->Root(), *of);
  if (!place) {
    throw InputError(
        "{}: the images of {} are not those of a folder beneath this one; name the image in the "
        "session's text",
        name,
        camera);
  }
  if (!place->Has(name)) {
    throw InputError(
        "{}: the session reads {} as images of {}; rename the file, or change 'images'",
        name,
        (place->folder / place->names).string(),
        camera);
  }
  // Two images of one name with different endings would be of one frame.
  const fs::path folder = project_->Root() / place->folder;
  std::error_code error;
  for (const auto& file : fs::directory_iterator(folder, error)) {
    if (place->Has(file.path().filename()) && file.path().stem() == fs::path(name).stem()) {
      throw InputError("{}: is there already; nothing is replaced, so give it another name",
                       (place->folder / file.path().filename()).string());
    }
  }
  return place->folder.string();
}

// The folder directly beneath the root to which an image of the camera can be added as a PNG file;
// null: none.
Json Api::PngFolder(const SessionCamera& camera) const {
  const auto place = FolderOf(project_->Root(), camera);
  if (!place || camera.images.size() != 1 || !place->Has("20261128.png")) return nullptr;
  const std::string name = place->folder.string();
  const bool is_plain = name.find('/') == std::string::npos && !name.starts_with('.');
  return is_plain && fs::is_directory(project_->Root() / name) && !name.empty() ? Json(name)
                                                                                : Json(nullptr);
}

Json Api::CamerasJson(const Session& session) {
  Json cameras = Json::array();
  for (const SessionCamera& camera : session.cameras) {
    Json frames = Json::array();
    if (!camera.images.empty()) {
      for (const FrameImage& image : images_.Of(camera)) frames.push_back(image.frame);
    }
    cameras.push_back({{"name", camera.name},
                       {"model", camera.auto_model ? kAuto : camera.model->name},
                       {"plenoptic", camera.model->plenoptic},
                       {"frames", frames},
                       {"folder", PngFolder(camera)}});
  }
  return cameras;
}

Answer Api::SessionAnswer(const SessionVersion& version) {
  Json json = {{"text", version.text},
               {"hash", version.hash},
               {"undo", version.undo},
               {"redo", version.redo},
               {"cameras", Json::array()},
               {"exclude", Json::array()},
               {"target", nullptr},
               {"target_text", nullptr},
               {"fields", {{"session", Json::array()}, {"target", Json::array()}}},
               {"problem", nullptr}};
  try {
    // What can be shown of a session that has mistakes, so that they can be mended.
    json["fields"]["session"] = SessionFields(YamlNode::Parse(version.text, "session.yaml"));
    if (const fs::path file = TargetFile(version.text); !file.empty()) {
      const std::string text = TextBeneath(project_->Root(), file, kMostText);
      json["target"] = RelativeTo(project_->Root(), file).string();
      json["target_text"] = text;
      json["fields"]["target"] = TargetFields(YamlNode::Parse(text, file.string()));
    }
    const Session session = ParseSession(version.text, project_->SessionFile(), CameraModels());
    for (const ExcludeRule& rule : session.exclude) {
      json["exclude"].push_back({{"camera", rule.camera},
                                 {"frame", rule.frame},
                                 {"markers", rule.markers},
                                 {"note", rule.note}});
    }
    json["cameras"] = CamerasJson(session);
    if (!session.scene) (void)ReadTarget(session.target);
  } catch (const Error& error) {
    json["problem"] = Escaped(project_->Relative(error.what()));
  }
  return JsonAnswer(json);
}

Answer Api::Changed(const std::optional<SessionVersion>& version) {
  if (!version) {
    return ErrorAnswer(
        409, "the session has changed meanwhile", "look at the new text, then change it again");
  }
  events_->Add("session", Json{{"hash", version->hash}}.dump());
  return SessionAnswer(*version);
}

Answer Api::SessionRequest(const Request& request) {
  if (!project_->HasSession()) {
    return ErrorAnswer(404, "there is no session yet", "propose one from the images");
  }
  if (Is(request, "GET", {"session"})) return SessionAnswer(project_->ReadVersion());
  if (Is(request, "PUT", {"session"})) {
    return Changed(
        project_->Write(NeededText(BodyOf(request), "text"), request.Header("if-match")));
  }
  if (Is(request, "PUT", {"session", "target"})) {
    WriteTarget(NeededText(BodyOf(request), "text"));
    return Changed(project_->ReadVersion());
  }
  if (Is(request, "POST", {"session", "undo"})) return Changed(project_->Undo());
  if (Is(request, "POST", {"session", "redo"})) return Changed(project_->Redo());
  if (Is(request, "POST", {"session", "exclude"}) || Is(request, "POST", {"session", "include"})) {
    return Exclude(request);
  }
  if (Is(request, "POST", {"session", "model"})) return UseModel(request);
  if (Is(request, "POST", {"session", "field"})) return SetField(request);
  return NoAnswer();
}

// The file that a session's text names as its target; empty: it names none beneath the root.
fs::path Api::TargetFile(const std::string& text) const {
  const auto target = YamlNode::Parse(text, "session.yaml").Find("target");
  if (!target || !target->IsScalar()) return {};
  const fs::path file = project_->Root() / target->AsString();
  std::error_code error;
  return IsBeneath(project_->Root(), file) && fs::exists(file, error) ? file : fs::path();
}

void Api::WriteTarget(const std::string& text) {
  const fs::path named = TargetFile(project_->ReadVersion().text);
  if (named.empty()) throw InputError("the session names no file with its target");
  const fs::path file = project_->Root() / RelativeTo(project_->Root(), named);
  // Read first: so it is a file beneath the root to which no link leads.
  (void)ReadBeneath(project_->Root(), file, kMostText);
  project_->WriteFile(file, text);
}

// A field of the form: the value of a key in the text of the session or of the target as it is now.
Answer Api::SetField(const Request& request) {
  const Json body = BodyOf(request);
  const std::string of = TextOf(body, "of"), value = TextOf(body, "value");
  const SessionVersion now = project_->ReadVersion();
  const Json known = Json::parse(SessionAnswer(now).body).at("fields");
  const auto fields = known.find(of);
  if (fields == known.end()) throw InputError("of: expected 'session' or 'target'");
  const auto field = std::ranges::find_if(
      *fields, [&](const Json& each) { return each.at("path") == body.value("path", Json()); });
  if (field == fields->end()) throw InputError("path: the text has no such field; edit the text");
  const auto path = field->at("path").get<std::vector<std::string>>();
  if (of == "session") {
    const std::string text = WithValue(now.text, path, value);
    // A text that cannot be read is not written.
    (void)YamlNode::Parse(text, "session.yaml");
    return Changed(project_->Write(text, now.hash));
  }
  const std::string text = TextBeneath(project_->Root(), TargetFile(now.text), kMostText);
  const bool required = field->at("required").get<bool>();
  WriteTarget(path.back() == "type"        ? WithTargetType(text, value)
              : value.empty() && !required ? WithoutKey(text, path.back())
                                           : WithValue(text, path, value));
  return Changed(project_->ReadVersion());
}

Answer Api::UseModel(const Request& request) {
  const Json body = BodyOf(request);
  const std::string model = TextOf(body, "model");
  const SessionVersion now = project_->ReadVersion();
  std::string text = now.text;
  const Json cameras = PartOf(body, "cameras", &Json::is_array, "a list");
  if (cameras.empty()) throw InputError("cameras: expected names");
  for (const Json& camera : cameras) {
    if (!camera.is_string()) throw InputError("cameras: expected names");
    text = WithValue(text, {"cameras", camera.get<std::string>(), "model"}, model);
  }
  // A text that cannot be read is not written.
  (void)ParseSession(text, project_->SessionFile(), CameraModels());
  return Changed(project_->Write(text, now.hash));
}

// try.yaml of the last `try`; null before there is one.
Answer Api::Tried() const { return {.body = JsonText(FileJson(fs::path(kTry) / "try.yaml"), -1)}; }

nlohmann::ordered_json Api::FileJson(const fs::path& name) const {
  const fs::path file = project_->Root() / name;
  std::error_code error;
  if (!fs::exists(file, error)) return nullptr;
  return YamlJson(YamlNode::Parse(TextBeneath(project_->Root(), file, kMostText), file.string()));
}

Answer Api::Exclude(const Request& request) {
  const ExcludeRule rule = RuleOf(BodyOf(request));
  const SessionVersion now = project_->ReadVersion();
  const std::string text =
      request.path[2] == "exclude" ? WithRule(now.text, rule) : WithoutRule(now.text, rule);
  // A text that cannot be read is not written.
  (void)ParseSession(text, project_->SessionFile(), CameraModels());
  return Changed(project_->Write(text, now.hash));
}

Answer Api::AddJob(const Request& request) {
  const Json body = BodyOf(request);
  const std::string kind = TextOf(body, "kind");
  const std::string session = project_->SessionFile().filename().string();
  Json job;
  if (kind == "init") {
    if (project_->HasSession()) {
      return ErrorAnswer(409, "there is a session already", "edit its text");
    }
    job = jobs_->Add({{"kind", kind}, {"input", "."}, {"out", session}});
  } else if (kind == "detect") {
    job = jobs_->Add(
        {{"kind", kind}, {"input", session}, {"out", ".plenocal/detections"}, {"cache", kCache}});
  } else if (kind == "calibrate") {
    job = AddCalibration(project_->NextRun());
  } else if (kind == "focus") {
    job = jobs_->Add(FocusJob(body));
  } else if (kind == "try") {
    job = jobs_->Add({{"kind", kind}, {"input", session}, {"out", kTry}});
  } else {
    return ErrorAnswer(400, fmt::format("'{}' is no kind of job", kind));
  }
  return JsonAnswer(job, 202);
}

Json Api::AddCalibration(int run) {
  return jobs_->Add({{"kind", "calibrate"},
                     {"input", project_->SessionFile().filename().string()},
                     {"out", fmt::format("runs/{}", run)},
                     {"cache", kCache}},
                    {{"run", run}});
}

Answer Api::WatchRequest(const Request& request) {
  const Json on = PartOf(BodyOf(request), "on", &Json::is_boolean, "true or false");
  if (on.is_null()) throw InputError("on: expected true or false");
  if (!on.get<bool>()) {
    watch_.Stop();
  } else if (!watch_.On()) {
    (void)project_->Parsed();  // a session that cannot be read is refused
    watched_run_ = project_->NextRun();
    has_arrivals_ = false;
    watch_.Start();
  }
  events_->Add("reset", "{}");  // other tabs show it, too
  return State();
}

// What the pictures of the live cameras add to a run.
Answer Api::Look(const Request& request) {
  const fs::path folder = project_->RunFolder(NumberOf(request.Query("run"), "run"));
  return JsonAnswer(live_.Weigh(folder, request.Query("pictures"), request.body));
}

// The picture that was weighed last is kept in files of this frame.
Answer Api::Keep(const Request& request) {
  const Json frame = PartOf(BodyOf(request), "frame", &Json::is_string, "a text");
  if (frame.is_null()) throw InputError("frame: expected a text");
  return JsonAnswer(live_.Keep(frame.get<std::string>()));
}

void Api::CalibrateArrivals() {
  if (!watch_.On()) return;
  const std::vector<Arrival> arrived = watch_.Arrived();
  if (!arrived.empty()) {
    has_arrivals_ = true;
    RenewWith(arrived);
  }
  if (jobs_->Busy()) return;
  if (has_arrivals_) {
    has_arrivals_ = false;
    events_->Add("session", "{}");
    AddCalibration(watched_run_);
  } else if (const fs::path folder = project_->RunFolder(watched_run_); fs::exists(folder)) {
    try {
      live_.Prepare(folder);
    } catch (const Error&) {
      return;  // of a plenoptic camera, for one: the jobs have all images
    }
  }
}

// One frame more: the calibration goes on with it before the job that follows has it, too.
void Api::RenewWith(const std::vector<Arrival>& arrived) {
  std::map<std::string, FrameImage> pictures;
  for (const auto& [camera, image] : arrived) {
    if (image.frame != arrived[0].image.frame) return;
    pictures.emplace(camera, image);
  }
  const fs::path folder = project_->RunFolder(watched_run_);
  if (!fs::exists(folder)) return;
  try {
    const Json renewed = live_.Renew(folder, pictures);
    if (!renewed.is_null()) events_->Add("renewed", renewed.dump());
  } catch (const Error&) {
    return;  // the job names what is wrong with the image
  }
}

Answer Api::Image(const Request& request) {
  const std::string &camera = request.path[2], &frame = request.path[3];
  const auto image = FindImage(camera, frame);
  if (!image) {
    return ErrorAnswer(404, fmt::format("the session has no image {} of {}", frame, camera));
  }
  const int width = request.Query("w").empty() ? 0 : NumberOf(request.Query("w"), "w");
  return ImageAnswer(project_->Root(), *image, width);
}

std::optional<FrameImage> Api::FindImage(const std::string& camera, const std::string& frame) {
  const Session session = project_->Parsed();
  for (const SessionCamera& each : session.cameras) {
    if (each.name != camera) continue;
    for (const FrameImage& image : images_.Of(each)) {
      if (image.frame == frame) return image;
    }
  }
  return std::nullopt;
}

std::filesystem::path Api::RunFile(int run, const std::string& name) const {
  const fs::path file = project_->RunFolder(run) / name;
  // Read first: so it is a file beneath the root to which no link leads.
  (void)ReadBeneath(project_->Root(), file, 512 * kMostText);
  return file;
}

// `focus` of one raw image, with the micro-image centres and the vignetting of a run.
Json Api::FocusJob(const Json& body) {
  const int run = NumberOf(body, "run", 0);
  const std::string camera = PlainName(TextOf(body, "camera"), "camera");
  const std::string frame = PlainName(TextOf(body, "frame"), "frame");
  const auto image = FindImage(camera, frame);
  if (!image) {
    throw InputError("the session has no image {} of {}", frame, camera);
  }
  Json job{{"kind", "focus"},
           {"input", (project_->Root() / RelativeTo(project_->Root(), image->path)).string()},
           {"grid", RunFile(run, fmt::format("micro_lenses_{}.csv", camera)).string()},
           {"vignetting", RunFile(run, fmt::format("vignetting_{}.tiff", camera)).string()},
           {"out", FocusFolder(run, camera, frame).string()}};
  if (image->store) {
    throw InputError(
        "{}: the workbench computes virtual depth of image files only; "
        "'plenocal focus' reads recordings",
        image->path.string());
  }
  const Session session = project_->Parsed();
  const auto of = std::ranges::find(session.cameras, camera, &SessionCamera::name);
  if (of->bayer) job["bayer"] = BayerName(*of->bayer);
  return job;
}

// The totally focused image and its virtual depth; null where no `focus` has written them.
Answer Api::Focus(const Request& request) const {
  const fs::path folder = FocusFolder(NumberOf(request.path[2], "run"),
                                      PlainName(request.path[4], "camera"),
                                      PlainName(request.path[5], "frame"));
  Json focus = FileJson(folder / "focused.yaml");
  if (focus.is_null()) return JsonAnswer(focus);
  if (request.path.size() == 7) {
    return ImageAnswer(
        project_->Root(), {.frame = "", .path = project_->Root() / folder / "focused.png"}, 0);
  }
  focus.update(DepthJson(project_->Root(), project_->Root() / folder / "virtual_depth.tiff"));
  return JsonAnswer(focus);
}

Answer Api::Run(const Request& request) {
  const int number = NumberOf(request.path[2], "run");
  const fs::path folder = project_->RunFolder(number);
  const std::vector<int> runs = project_->Runs();
  if (std::ranges::find(runs, number) == runs.end()) {
    return ErrorAnswer(404, fmt::format("there is no run {}", number));
  }
  if (request.path.size() == 3) return JsonAnswer(RunJson(folder, number));
  const std::string &part = request.path[3], camera = request.Query("camera");
  if (Is(request, "GET", {"runs", "*", "focus", "*", "*"}) ||
      Is(request, "GET", {"runs", "*", "focus", "*", "*", "focused"})) {
    return Focus(request);
  }
  if (request.path.size() > 4) return NoAnswer();
  if (part == "points") return JsonAnswer(PointsJson(folder, camera, request.Query("frame")));
  if (part == "residuals") return JsonAnswer(ResidualsJson(folder, camera));
  if (part == "lenses") {
    const std::string file = fmt::format("micro_lenses_{}.csv", PlainName(camera, "camera"));
    return JsonAnswer(LensesJson(folder, camera, RunFile(number, file)));
  }
  if (part == "influence") return JsonAnswer(InfluenceJson(folder));
  if (part == "preview") {
    const Session session = project_->Parsed();
    return JsonAnswer(PreviewJson(folder, session, [&](const std::string& name) {
      const auto of = std::ranges::find(session.cameras, name, &SessionCamera::name);
      return of == session.cameras.end() || of->images.empty() ? std::vector<FrameImage>()
                                                               : images_.Of(*of);
    }));
  }
  if (part == "straight") return Straight(request);
  if (part == "space") return JsonAnswer(SpaceJson(folder));
  if (part == "accuracy") return JsonAnswer(AccuracyJson(folder));
  if (part == "maps") return JsonAnswer(MapsJson(folder, camera));
  if (part == "report.html") {
    return {.type = "application/octet-stream",
            .body = TextBeneath(project_->Root(), folder / "report.html", 512 * kMostText),
            .headers = {{"Content-Disposition", "attachment; filename=report.html"}}};
  }
  return part == "export" ? Export(request) : NoAnswer();
}

// A frame without distortion; with `with`, rectified beside that camera's image, both in the order
// of the calibration.
Answer Api::Straight(const Request& request) {
  const auto record = RecordOf(project_->RunFolder(NumberOf(request.path[2], "run")));
  const auto image = [&](const std::string& camera) {
    const std::string frame = request.Query("frame");
    const auto found = FindImage(camera, frame);
    if (!found) throw InputError("the session has no image {} of {}", frame, camera);
    return *found;
  };
  const CalibratedCamera* camera = &FindCamera(*record, request.Query("camera"));
  if (request.Query("with").empty()) {
    return UndistortedAnswer(project_->Root(), image(camera->name), *camera);
  }
  const CalibratedCamera* other = &FindCamera(*record, request.Query("with"));
  if (other < camera) std::swap(camera, other);
  return RectifiedAnswer(
      project_->Root(), {image(camera->name), image(other->name)}, {camera, other});
}

Answer Api::Suggest(const Request& request) const {
  const Json body = BodyOf(request);
  SuggestRequest suggest;
  suggest.input = project_->RunFolder(NumberOf(body, "run", 0));
  suggest.count = NumberOf(body, "count", suggest.count);
  return JsonAnswer(SuggestionsJson(SuggestViews(suggest, {})));
}

Answer Api::Compare(const Request& request) const {
  const auto file = [&](const char* name) {
    return (project_->RunFolder(NumberOf(request.Query(name), name)) / "calibration.yaml").string();
  };
  const std::string a = file("a"), b = file("b");
  const CalibrationComparison comparison = CompareFiles(a, b, {});
  return JsonAnswer({{"command", CommandLineText({"compare", a, b})},
                     {"text", ComparisonText(comparison, a, b)},
                     {"maps", DifferenceJson(comparison)}});
}

// The files of another program, under the names that it expects, with the command line that makes
// them.
Answer Api::Export(const Request& request) const {
  const std::string format = PlainName(request.Query("format"), "format");
  const auto formats = CameraFormats();
  const auto found = std::ranges::find(formats, format, &CameraFormat::name);
  if (found == formats.end()) throw InputError("there is no format '{}'", format);
  const fs::path out = project_->Root() / ".plenocal" / "export" / format / found->file;
  const fs::path run = project_->RunFolder(NumberOf(request.path[2], "run"));
  ExportRequest files;
  files.calibration = run / "calibration.yaml";
  files.format = format;
  files.out = out;
  std::vector<std::string> arguments{
      "export", files.calibration.string(), "--format", format, "-o", out.filename().string()};
  if (!request.Query("camera").empty()) {
    files.cameras = {PlainName(request.Query("camera"), "camera")};
    arguments.insert(arguments.end(), {"--camera", files.cameras[0]});
  }
  fs::create_directories(out.parent_path());
  Json written = Json::array();
  for (const fs::path& file : ExportCalibration(files, {})) {
    written.push_back({{"name", file.filename().string()},
                       {"text", TextBeneath(project_->Root(), file, 64 * kMostText)}});
  }
  return JsonAnswer({{"command", CommandLineText(arguments)}, {"files", written}});
}

// The target as it is printed: its sheets, or why there is none. Each text of the target has a
// folder.
Answer Api::DrawTarget() {
  const std::lock_guard lock(drawing_);
  const Session session = project_->Parsed();
  const auto without = [](const std::string& why) {
    return JsonAnswer({{"folder", ""}, {"sheets", Json::array()}, {"why", why}});
  };
  if (session.target.file.empty()) {
    return without("the target stands in the session; one in a file of its own is drawn here");
  }
  const std::string text = session.target.Text();
  const std::string name = HashBytes(std::vector<std::uint8_t>(text.begin(), text.end()));
  const fs::path folder = project_->Root() / kDrawings / name;
  if (!fs::exists(folder)) {
    const fs::path made = folder.string() + ".partial";
    fs::remove_all(made);
    fs::create_directories(made);
    try {
      PrintTarget({.target = session.target.file, .out = made / "target.svg", .numbers = true});
    } catch (const Error& error) {
      return without(error.what());
    }
    fs::rename(made, folder);
  }
  std::vector<std::string> sheets;
  for (const auto& file : fs::directory_iterator(folder)) {
    sheets.push_back(file.path().filename().string());
  }
  // target-10.svg after target-9.svg.
  std::ranges::sort(
      sheets, {}, [](const std::string& sheet) { return std::pair(sheet.size(), sheet); });
  return JsonAnswer({{"folder", name}, {"sheets", sheets}, {"why", nullptr}});
}

Answer Api::Sheet(const Request& request) const {
  const fs::path file = project_->Root() / kDrawings / PlainName(request.path[2], "folder") /
                        PlainName(request.path[3], "sheet");
  return {.type = "image/svg+xml", .body = TextBeneath(project_->Root(), file, 64 * kMostText)};
}

}  // namespace plenocal::workbench
