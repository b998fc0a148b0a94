// A program in C++17 that sees nothing but the installed package: renders a floor under a sky.
#include <fieldtrace/fieldtrace.hpp>
#include <iostream>
#include <vector>

int main() {
  try {
    ft::Scene scene{ft::Device(2)};
    const float positions[] = {-1, 0, -1, -1, 0, 1, 1, 0, 1, 1, 0, -1};
    const uint32_t triangles[] = {0, 1, 2, 0, 2, 3};
    scene.add_instance(scene.add_mesh(positions, 4, triangles, 2));
    const float from[] = {0, 3, 0.1f}, to[] = {0, 0, 0}, up[] = {0, 0, -1}, sky[] = {1, 1, 1};
    scene.check(ftSetSceneCamera(scene.get(), from, to, up, 20, 8, 8));
    scene.check(ftSetSceneSky(scene.get(), sky));
    scene.set("spp", 4);
    scene.set("max_depth", 2);
    scene.commit();
    std::vector<float> pixels(8 * 8 * 3);
    scene.render(pixels.data());
    // Reflectance .5 under a sky of radiance 1.
    if (pixels[0] < 0.45f || pixels[0] > 0.55f) return 2;
    try {
      scene.set("nonsense", 1);
      return 3;
    } catch (const ft::Error& e) {
      if (std::string(e.what()).find("nonsense") == std::string::npos) return 4;
    }
  } catch (const ft::Error& e) {
    std::cerr << e.what() << "\n";
    return 1;
  }
  std::cout << "consumer: all is well\n";
}
