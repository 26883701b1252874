MODULE joints
  LOCAL CONST jointtarget jp1:=[[12.252,17.150,9.962,3.054,36.403,11.724],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST jointtarget jp2 := [ [1.095,15.782,10.347,7.423,36.455,1.012] , [9E+09,9E+09,9E+09,9E+09,9E+09,9E+09] ];
  PROC main()
    VelSet 10,5000;
    MoveAbsJ jp1\NoEOffs,vmax,fine,tool0\WObj:=wobj0;
    WaitTime\InPos,10.00;
    MoveAbsJ jp2,v100,z10,tool0;
    MoveAbsJ [[5.588,9.011,5.082,8.963,48.919,10.268],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]\NoEOffs,v100,fine,tool0;
  ENDPROC
ENDMODULE
