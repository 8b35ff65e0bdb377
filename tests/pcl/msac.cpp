// Fits lines to the windows of exported sections with PCL's MSAC and says how long a scan takes and how well it does.
//
//   ./msac THRESHOLD_M FILE...
//
// What is timed is what a program that uses PCL does for each window: build the model, compute it (PCL's own limits: probability 0.99, 1000
// iterations), select the inliers and refine the line on them by least squares. Reading the files and making the clouds is not timed. Times are the processor's, the
// least of three rounds, as those of `export_scenes`.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/msac.h>
#include <pcl/sample_consensus/sac_model_line.h>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Line = pcl::SampleConsensusModelLine<pcl::PointXYZ>;

struct Window {
    int section;
    bool adjacent;
    double truth_deg;
    Cloud::Ptr cloud;
};

struct Errors {
    double squares = 0;
    int found = 0, far = 0, all = 0;
    void add(double error) {
        squares += error * error;
        found += 1;
        far += std::abs(error) > 1.0;
    }
    double rms() const { return std::sqrt(squares / std::max(found, 1)); }
};

static std::vector<Window> read(const char *path) {
    std::ifstream file(path);
    if (!file) {
        std::fprintf(stderr, "%s: cannot be opened\n", path);
        std::exit(1);
    }
    std::vector<Window> windows;
    for (std::string text; std::getline(file, text);) {
        std::istringstream words(text);
        std::string set, side, slope;
        Window window{0, false, 0.0, Cloud::Ptr(new Cloud)};
        words >> set >> window.section >> side >> slope >> window.truth_deg;
        window.adjacent = slope == "adjacent";
        for (float y, z; words >> y >> z;) window.cloud->push_back(pcl::PointXYZ(y, z, 0.0f));
        windows.push_back(window);
    }
    return windows;
}

int main(int count, char **arguments) {
    if (count < 3) {
        std::fprintf(stderr, "usage: msac THRESHOLD_M FILE...\n");
        return 2;
    }
    const double threshold = std::atof(arguments[1]);
    std::printf("%14s %12s %22s %18s %16s\n", "set", "us a scan", "RMS degrees adj / opp", "above 1 degree", "not found");
    for (int i = 2; i < count; ++i) {
        const auto windows = read(arguments[i]);
        Errors errors[2];
        double least = INFINITY;
        for (int round = 0; round < 3; ++round) {
            errors[0] = errors[1] = Errors();
            const std::clock_t begin = std::clock();
            for (const Window &window : windows) {
                Errors &of_kind = errors[window.adjacent ? 0 : 1];
                of_kind.all += 1;
                if (window.cloud->size() < 3) continue;
                Line::Ptr model(new Line(window.cloud));
                pcl::MEstimatorSampleConsensus<pcl::PointXYZ> search(model, threshold);
                if (!search.computeModel()) continue;
                Eigen::VectorXf rough, refined;
                pcl::Indices inliers;
                search.getModelCoefficients(rough);
                search.getInliers(inliers);
                model->optimizeModelCoefficients(inliers, rough, refined);
                of_kind.add(std::atan2(refined[4] * (refined[3] < 0 ? -1 : 1), std::abs(refined[3])) * 180.0 / M_PI - window.truth_deg);
            }
            least = std::min(least, double(std::clock() - begin) * 1e6 / CLOCKS_PER_SEC);
        }
        const int scans = windows.empty() ? 1 : windows.back().section + 1;
        std::string name(arguments[i]);
        name = name.substr(name.find_last_of('/') + 1);
        std::printf("%14s %12.1f %13.3f / %.3f %12d / %d %12d / %d\n", name.c_str(), least / scans, errors[0].rms(), errors[1].rms(),
                    errors[0].far, errors[1].far, errors[0].all - errors[0].found, errors[1].all - errors[1].found);
    }
}
