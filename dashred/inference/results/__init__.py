"""What a fitted law means: verdict, location, parameter change."""
