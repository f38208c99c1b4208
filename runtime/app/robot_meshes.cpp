#include "app/robot_meshes.hpp"

#include <tinyxml.h>

#include <algorithm>
#include <string_view>
#include <system_error>

namespace crux {
namespace {

/// Where a URDF's name for a file leads from the robot's folder: "package://NAME/" is that folder.
std::filesystem::path inner(std::string_view filename) {
  constexpr std::string_view kFile = "file://", kPackage = "package://";
  if (filename.starts_with(kFile)) return filename.substr(kFile.size());
  if (!filename.starts_with(kPackage)) return filename;
  const std::size_t slash = filename.find('/', kPackage.size());
  return slash == std::string_view::npos ? std::string_view() : filename.substr(slash + 1);
}

std::string within(const std::filesystem::path& path) {
  std::filesystem::path found;
  for (const std::filesystem::path& part : path.relative_path())
    if (!part.empty() && part != "." && part != "..") found /= part;
  return found.generic_string();
}

/// Whether a file lies in a folder, symbolic links followed.
bool lies_in(const std::filesystem::path& file, const std::filesystem::path& folder) {
  std::error_code unknown;  // what cannot be looked at is not there
  const std::filesystem::path place = std::filesystem::canonical(file, unknown);
  if (unknown) return false;
  const std::filesystem::path whole = std::filesystem::canonical(folder, unknown);
  return !unknown && std::ranges::mismatch(whole, place).in1 == whole.end();
}

}  // namespace

std::vector<RobotMesh> meshes_of(const std::string& urdf, const std::filesystem::path& folder) {
  TiXmlDocument document;
  document.Parse(urdf.c_str());
  std::vector<RobotMesh> found;
  TiXmlHandle robot(document.RootElement());
  for (auto* link = robot.FirstChildElement("link").ToElement(); link; link = link->NextSiblingElement("link"))
    for (auto* visual = link->FirstChildElement("visual"); visual; visual = visual->NextSiblingElement("visual")) {
      const auto* mesh = TiXmlHandle(visual).FirstChildElement("geometry").FirstChildElement("mesh").ToElement();
      const char* filename = mesh ? mesh->Attribute("filename") : nullptr;
      if (filename == nullptr) continue;
      RobotMesh one{within(inner(filename)), folder / inner(filename)};
      std::error_code unknown;
      if (!lies_in(one.path, folder) || !std::filesystem::is_regular_file(one.path, unknown)) continue;
      if (std::ranges::find(found, one.name, &RobotMesh::name) == found.end()) found.push_back(std::move(one));
    }
  return found;
}

}  // namespace crux
