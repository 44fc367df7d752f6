// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "framework/experiment/figure.h"

namespace variform {

/// Figures of more triangles than this, all together, would make the page too heavy: those beyond are left out.
inline constexpr std::size_t kViewerTriangles = 400000;

/// The interactive view of figures in space as a piece of HTML: two of them side by side under one camera (drag turns,
/// the wheel zooms, so do fingers), with edges and cell colours or checkerboard as in the pictures. Everything is
/// inside: the data, and three.js, which is read from the file that the environment variable VARIFORM_THREE_JS names,
/// else from where it was when variform was configured (Debian's libjs-three); its OrbitControls.js is looked for at
/// examples/js/controls/ beside it. Where the library is not there, the piece says so in one sentence. Empty without
/// figures in space.
std::string viewer_html(const std::vector<MeshFigure>& figures, const Camera& camera,
                        std::size_t most_triangles = kViewerTriangles);

/// Where three.js was found; empty where it or its controls are missing.
std::filesystem::path viewer_library();

}  // namespace variform
