/* The kernel's sum over the bodies, by hand: acceleration, gradient, largest tides, in eight lanes. See force_loop.py. */
#include <math.h>

void expand_bodies(long bodies, const double *restrict X, const double *restrict P, const double *restrict gm,
                   double *restrict R, double *restrict S, double *restrict tide, double *restrict bend)
{
    double r[24] = {0}, s[48] = {0}, t[8] = {0}, b4[8] = {0};
    for (long b = 1; b < bodies; b++) {
        const double g = gm[b], *p = P + 24 * b;
#pragma GCC ivdep
        for (int l = 0; l < 8; l++) {
            double dx = X[l] - p[l], dy = X[8 + l] - p[8 + l], dz = X[16 + l] - p[16 + l];
            double r2 = dx * dx + dy * dy + dz * dz, ir = 1.0 / sqrt(r2), ir2 = ir * ir;
            double f = g * ir2 * ir, f3 = 3.0 * f * ir2;
            r[l] -= f * dx, r[8 + l] -= f * dy, r[16 + l] -= f * dz;
            s[l] += f3 * dx * dx - f, s[8 + l] += f3 * dx * dy, s[16 + l] += f3 * dx * dz;
            s[24 + l] += f3 * dy * dy - f, s[32 + l] += f3 * dy * dz, s[40 + l] += f3 * dz * dz - f;
            t[l] = f > t[l] ? f : t[l];
            b4[l] = f * ir > b4[l] ? f * ir : b4[l];
        }
    }
    for (int i = 0; i < 24; i++) R[i] = r[i];
    for (int i = 0; i < 48; i++) S[i] = s[i];
    for (int i = 0; i < 8; i++) tide[i] = t[i], bend[i] = b4[i];
}

void point_masses(long bodies, const double *restrict X, const double *restrict P, const double *restrict gm,
                  double *restrict A, double *restrict tide)
{
    double a[24] = {0}, t[8] = {0};
    for (long b = 0; b < bodies; b++) {
        const double g = gm[b], *p = P + 24 * b;
#pragma GCC ivdep
        for (int l = 0; l < 8; l++) {
            double dx = X[l] - p[l], dy = X[8 + l] - p[8 + l], dz = X[16 + l] - p[16 + l];
            double r2 = dx * dx + dy * dy + dz * dz, f = g / (r2 * sqrt(r2));
            a[l] -= f * dx, a[8 + l] -= f * dy, a[16 + l] -= f * dz;
            t[l] = f > t[l] ? f : t[l];
        }
    }
    for (int i = 0; i < 24; i++) A[i] = a[i];
    for (int i = 0; i < 8; i++) tide[i] = t[i];
}

#define LOOP(name, call) \
    void name(long m, long n, const double *X, const double *P, const double *gm, double *A, double *B, double *C, double *D) \
    { for (long i = 0; i < m; i++) { call; __asm__ volatile("" ::: "memory"); } }
LOOP(loop_expand, expand_bodies(n, X, P, gm, A, B, C, D))
LOOP(loop_masses, point_masses(n, X, P, gm, A, C))
