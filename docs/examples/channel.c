/* A scalar in a channel with an obstacle at its lower wall: finite volumes of second order.

   dc/dt + div(v c) = D lap(c) + hidden terms

   v is a flow of a stream function around the obstacle. Near its end the channel leads c back to
   the profile of the inlet, so that x is a ring. Values are at the nodes of the grid of dashred.

   cc -O2 -DWITH_NETCDF channel.c -o channel -lnetcdf -lm    steps the states of a file
   cc -O2 channel.c -o record -lm                            prints a record with hidden terms */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MX 256
#define MY 129
static const double X = 4.0, Y = 1.0;
static int nx, ny;
static double dx, dy, psi[MX][MY + 1], east[MX][MY], north[MX][MY], c[MX][MY], r[MX][MY];
static char solid[MX][MY];
static struct { double strength, x, y, width, drag; } hidden = {0, 0, 0, 1, 0};

static double inlet(double y) { return 1 + 0.5 * cos(M_PI * y); }
static double height(int j) { return j == 0 || j == ny - 1 ? dy / 2 : dy; }
static int right(int i) { return (i + 1) % nx; }
static int left(int i) { return (i + nx - 1) % nx; }

static void set_grid(int along, int across) {
    nx = along, ny = across, dx = X / nx, dy = Y / (ny - 1);
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < ny; j++)
            solid[i][j] = i * dx > 1.1876 && i * dx < 1.5624 && j * dy < 0.4687;
}

/* psi at the south-west corner of each cell: 0 at the lower wall and the obstacle, Y at the top */
static void set_flow(double speed) {
    static char held[MX][MY + 1];
    for (int i = 0; i < nx; i++)
        for (int j = 0; j <= ny; j++) {
            int w = left(i), below = j && (solid[i][j - 1] || solid[w][j - 1]);
            held[i][j] = j == 0 || j == ny || solid[i][j] || solid[w][j] || below;
            psi[i][j] = j == ny ? Y : held[i][j] ? 0 : (j - 0.5) * dy;
        }
    for (int sweep = 0; sweep < 4000; sweep++) {   /* successive over-relaxation */
        double change = 0;
        for (int i = 0; i < nx; i++)
            for (int j = 1; j < ny; j++) {
                if (held[i][j]) continue;
                double up = j == ny - 1 ? dy / 2 : dy, down = j == 1 ? dy / 2 : dy;
                double an = 2 / (up * (up + down)), as = 2 / (down * (up + down));
                double ax = 1 / (dx * dx);
                double sum = ax * (psi[right(i)][j] + psi[left(i)][j]) + an * psi[i][j + 1];
                double d = (sum + as * psi[i][j - 1]) / (2 * ax + an + as) - psi[i][j];
                psi[i][j] += 1.85 * d;
                change = fmax(change, fabs(d));
            }
        if (change < 1e-12) break;
    }
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < ny; j++) {   /* volume through the east and the north face */
            east[i][j] = speed * (psi[right(i)][j + 1] - psi[right(i)][j]);
            north[i][j] = j == ny - 1 ? 0 : -speed * (psi[right(i)][j + 1] - psi[i][j + 1]);
        }
}

static double limited(double a, double b) { return a * b > 0 ? 2 * a * b / (a + b) : 0; }

/* Value at the face between b and e; a and f are beyond them. */
static double face(double volume, double a, double b, double e, double f) {
    return volume > 0 ? b + 0.5 * limited(b - a, e - b) : e - 0.5 * limited(e - b, f - e);
}

static void set_rate(double D) {
    memset(r, 0, sizeof r);
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < ny; j++) {
            if (solid[i][j]) continue;
            int e = right(i), f = right(e), w = left(i);
            if (!solid[e][j]) {
                double before = solid[w][j] ? c[i][j] : c[w][j];
                double after = solid[f][j] ? c[e][j] : c[f][j];
                double flux = east[i][j] * face(east[i][j], before, c[i][j], c[e][j], after);
                flux -= D * height(j) * (c[e][j] - c[i][j]) / dx;
                r[i][j] -= flux, r[e][j] += flux;
            }
            if (j < ny - 1 && !solid[i][j + 1]) {
                double before = j && !solid[i][j - 1] ? c[i][j - 1] : c[i][j];
                double after = j < ny - 2 ? c[i][j + 2] : c[i][j + 1];
                double flux = north[i][j] * face(north[i][j], before, c[i][j], c[i][j + 1], after);
                flux -= D * dx * (c[i][j + 1] - c[i][j]) / dy;
                r[i][j] -= flux, r[i][j + 1] += flux;
            }
        }
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < ny; j++) {
            if (solid[i][j]) continue;
            double x = i * dx, y = j * dy;
            double a = (x - hidden.x) / hidden.width, b = (y - hidden.y) / hidden.width;
            double back = x > 3.5 ? 12 * pow(sin(M_PI * (x - 3.5) / 0.5), 2) : 0;
            r[i][j] = r[i][j] / (dx * height(j)) + back * (inlet(y) - c[i][j]);
            r[i][j] += hidden.strength * exp(-(a * a + b * b) / 2) - hidden.drag * c[i][j];
        }
}

static void advance(double D, double dt) {
    static double old[MX][MY];
    const double part[3] = {0, 0.75, 1.0 / 3};   /* Runge-Kutta of third order */
    int steps = (int)ceil(dt / fmin(0.4 * dx / 2.2, 0.2 * dy * dy / D));
    for (int s = 0; s < steps; s++) {
        memcpy(old, c, sizeof c);
        for (int k = 0; k < 3; k++) {
            set_rate(D);
            for (int i = 0; i < nx; i++)
                for (int j = 0; j < ny; j++) {
                    if (solid[i][j]) continue;
                    double moved = c[i][j] + dt / steps * r[i][j];
                    c[i][j] = part[k] * old[i][j] + (1 - part[k]) * moved;
                }
        }
    }
}

#ifdef WITH_NETCDF
#include <netcdf.h>
static void check(int status) {
    if (status == NC_NOERR) return;
    fprintf(stderr, "%s\n", nc_strerror(status));
    exit(2);
}

int main(int argc, char **argv) {
    if (argc != 3) return 1;
    int in, out, id, dims[3];
    size_t size[3];
    const char *names[3] = {"member", "x", "y"};
    double D, speed;
    check(nc_open(argv[1], NC_NOWRITE, &in));
    for (int k = 0; k < 3; k++) {
        check(nc_inq_dimid(in, names[k], &id));
        check(nc_inq_dimlen(in, id, &size[k]));
    }
    size_t members = size[0], cells = size[1] * size[2];
    double *u = malloc(members * cells * sizeof *u), *dt = malloc(members * sizeof *dt);
    check(nc_inq_varid(in, "c", &id));
    check(nc_get_var_double(in, id, u));
    check(nc_inq_varid(in, "dt", &id));
    check(nc_get_var_double(in, id, dt));
    check(nc_get_att_double(in, NC_GLOBAL, "D", &D));
    check(nc_get_att_double(in, NC_GLOBAL, "speed", &speed));
    check(nc_close(in));
    set_grid(size[1], size[2]);
    set_flow(speed);
    for (size_t m = 0; m < members; m++) {
        double *own = u + m * cells;
        for (int i = 0; i < nx; i++) memcpy(c[i], own + i * ny, ny * sizeof *own);
        advance(D, dt[m]);
        for (int i = 0; i < nx; i++) memcpy(own + i * ny, c[i], ny * sizeof *own);
    }
    check(nc_create(argv[2], NC_CLOBBER, &out));
    for (int k = 0; k < 3; k++) check(nc_def_dim(out, names[k], size[k], &dims[k]));
    check(nc_def_var(out, "c", NC_DOUBLE, 3, dims, &id));
    check(nc_enddef(out));
    check(nc_put_var_double(out, id, u));
    check(nc_close(out));
    return 0;
}
#else
int main(int argc, char **argv) {   /* strength, x, y and width of a source; drag */
    if (argc != 6) return 1;
    double *values[] = {&hidden.strength, &hidden.x, &hidden.y, &hidden.width, &hidden.drag};
    for (int k = 0; k < 5; k++) *values[k] = atof(argv[1 + k]);
    set_grid(32, 17);
    set_flow(1.0);
    for (int i = 0; i < nx; i++)
        for (int j = 0; j < ny; j++)
            c[i][j] = solid[i][j] ? 0 : inlet(j * dy) * (1 + 0.4 * sin(M_PI * i * dx / 2));
    for (int sample = 0; sample <= 60; sample++) {
        for (int i = 0; i < nx; i++)
            for (int j = 0; j < ny; j++) printf("%.10g ", c[i][j]);
        printf("\n");
        advance(0.02, 0.1);
    }
    return 0;
}
#endif
