// SPDX-License-Identifier: BSD-3-Clause
#include "framework/domain/mesh_io.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cerrno>
#include <cstdio>
#include <random>
#include <system_error>

#include "framework/base/error.h"
#include "framework/domain/io/formats.h"
#include "framework/domain/io/mesh_builder.h"
#include "framework/domain/io/reader.h"

namespace variform {
namespace {

const std::vector<io::Format>& formats() {
  static const std::vector<io::Format> table = {
      io::obj_format(),   io::off_format(),  io::ply_format(), io::stl_format(),
      io::medit_format(), io::gmsh_format(), io::vtu_format(),
  };
  return table;
}

/// The format of a file by its extension, in upper or lower case, and the one before .gz where that is allowed.
const io::Format& format_of(const std::filesystem::path& path, bool may_be_packed) {
  const bool is_packed = may_be_packed && path.extension() == ".gz";
  std::string extension = (is_packed ? path.stem() : path).extension().string();
  for (char& c : extension) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  for (const io::Format& format : formats()) {
    if (format.extension == extension) return format;
  }
  throw UsageError(fmt::format("{}: unknown extension '{}'; known: {}", path.string(), extension,
                               fmt::join(mesh_extensions(), ", ")));
}

/// Extensions of the formats that have a property.
std::string extensions_with(bool io::Format::*property) {
  std::vector<std::string> extensions;
  for (const io::Format& format : formats()) {
    if (format.*property) extensions.push_back(format.extension);
  }
  return fmt::format("{}", fmt::join(extensions, ", "));
}

void check_fields(const std::filesystem::path& path, const Mesh& mesh, const std::vector<MeshField>& fields) {
  for (const MeshField& field : fields) {
    const Index rows = field.on == MeshField::On::vertices ? mesh.vertex_count() : mesh.cell_count();
    if (field.values.rows() != rows || field.values.cols() < 1 || field.values.cols() > 9) {
      throw UsageError(fmt::format("{}: field '{}' has {} rows and {} columns, expected {} rows and 1 to 9 columns",
                                   path.string(), field.name, field.values.rows(), field.values.cols(), rows));
    }
  }
}

/// What no reader would accept is not written.
void check_writable(const std::filesystem::path& path, const Mesh& mesh, const io::Format& format) {
  const auto columns = mesh.positions.cols();
  if ((columns != 2 && columns != 3) || (mesh.cells.cols() != 3 && mesh.cells.cols() != 4)) {
    throw DataError(
        fmt::format("{}: cannot write a mesh with {} coordinates per vertex and {} vertices per cell; "
                    "expected 2 or 3 coordinates, 3 or 4 vertices",
                    path.string(), columns, mesh.cells.cols()));
  }
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    const auto point = mesh.positions.row(v);
    if (!point.allFinite() || (format.is_single_precision && !point.cast<float>().allFinite())) {
      throw DataError(fmt::format("{}: cannot write vertex {} (counted from 0): its coordinates are not finite{}",
                                  path.string(), v, format.is_single_precision ? " in single precision" : ""));
    }
  }
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    for (const Index v : mesh.cells.row(c)) {
      if (v < 0 || v >= mesh.vertex_count()) {
        throw DataError(fmt::format("{}: cannot write cell {} (counted from 0): it names vertex {} of {}",
                                    path.string(), c, v, mesh.vertex_count()));
      }
    }
  }
}

[[noreturn]] void fail_write(const std::filesystem::path& path, int error) {
  throw DataError(fmt::format("{}: cannot be written: {}", path.string(), std::generic_category().message(error)));
}

}  // namespace

MeshFile io::parse_mesh(const std::filesystem::path& path, std::string_view content, const ReadOptions& options) {
  Reader reader(path.string(), content);
  MeshBuilder builder(reader, options);
  format_of(path, true).read(reader, builder);
  return builder.finish();
}

MeshFile read_mesh(const std::filesystem::path& path, const ReadOptions& options) {
  format_of(path, true);  // a wrong name is told before a missing file
  return io::parse_mesh(path, io::load_file(path), options);
}

void write_mesh(const std::filesystem::path& path, const Mesh& mesh, const std::vector<MeshField>& fields) {
  const io::Format& format = format_of(path, false);
  check_writable(path, mesh, format);
  check_fields(path, mesh, fields);
  if (mesh.cells.cols() == 4 && !format.holds_tetrahedra) {
    throw UsageError(fmt::format("{}: {} files hold no tetrahedra; expected one of {}", path.string(), format.extension,
                                 extensions_with(&io::Format::holds_tetrahedra)));
  }
  if (!fields.empty() && !format.holds_fields) {
    throw UsageError(fmt::format("{}: {} files hold no fields; expected one of {}", path.string(), format.extension,
                                 extensions_with(&io::Format::holds_fields)));
  }
  write_file(path, format.write(mesh, fields));
}

void write_obj_uv(const std::filesystem::path& path, const Mesh& mesh, const Matrix& uv, const IndexMatrix& uv_cells) {
  const io::Format& format = format_of(path, false);
  if (format.extension != io::obj_format().extension) {
    throw UsageError(fmt::format("{}: expected an .obj file for texture coordinates", path.string()));
  }
  check_writable(path, mesh, format);
  if (mesh.cells.cols() != 3 || uv.cols() != 2 || uv_cells.cols() != 3 || uv_cells.rows() != mesh.cells.rows()) {
    throw UsageError(
        fmt::format("{}: texture coordinates of {} columns with {} x {} indices for {} cells of {} corners; expected 2 "
                    "columns and 3 indices for each cell of 3 corners",
                    path.string(), uv.cols(), uv_cells.rows(), uv_cells.cols(), mesh.cell_count(), mesh.cells.cols()));
  }
  for (Index row = 0; row < uv.rows(); ++row) {
    if (!uv.row(row).allFinite()) {
      throw DataError(fmt::format("{}: cannot write texture coordinates {} (counted from 0): they are not finite",
                                  path.string(), row));
    }
  }
  for (Index c = 0; c < mesh.cell_count(); ++c) {
    for (const Index row : uv_cells.row(c)) {
      if (row < 0 || row >= uv.rows()) {
        throw DataError(fmt::format("{}: cannot write cell {} (counted from 0): it names texture coordinates {} of {}",
                                    path.string(), c, row, uv.rows()));
      }
    }
  }
  write_file(path, io::obj_with_uv(mesh, uv, uv_cells));
}

const std::vector<std::string>& mesh_extensions() {
  static const std::vector<std::string> extensions = [] {
    std::vector<std::string> names;
    for (const io::Format& format : formats()) names.push_back(format.extension);
    return names;
  }();
  return extensions;
}

void write_file(const std::filesystem::path& path, const std::string& content) {
  // A random name of its own, so that processes that write the same file do not meet.
  std::random_device random;
  std::filesystem::path temporary = path;
  temporary += fmt::format(".{:08x}.tmp", random());

  std::FILE* const file = std::fopen(temporary.c_str(), "wbx");
  if (file == nullptr) fail_write(path, errno);
  const bool is_written = std::fwrite(content.data(), 1, content.size(), file) == content.size();
  int error = is_written ? 0 : errno;
  if (std::fclose(file) != 0 && error == 0) error = errno;
  if (error == 0) {
    std::error_code rename_error;
    std::filesystem::rename(temporary, path, rename_error);
    error = rename_error.value();
  }
  if (error != 0) {
    std::error_code ignored;
    std::filesystem::remove(temporary, ignored);
    fail_write(path, error);
  }
}

}  // namespace variform
